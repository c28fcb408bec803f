"""Stochasticity: how undecided a policy is in the states that it visits."""

import numpy as np

from benchmark.metrics.episode_data import EpisodeData
from benchmark.metrics.measure import Columns, ratio
from smarts.types.actions import ActionSpaceType, LaneAction

PROBABILITIES, DEVIATION = "probabilities", "std"
"""Names of extras. Probabilities are those of all actions in the sampling distribution, whatever the mode of
evaluation; deviations are those of actions whose range counts as -1 to 1."""


def measure(episode: EpisodeData) -> Columns:
    """Return the sum over states, and how many there were."""
    columns = {name: np.zeros(episode.count) for name in METRIC.columns}
    for agent in np.flatnonzero(episode.entered).tolist():
        for each in (*_discrete(episode, agent), *_continuous(episode, agent)):
            columns["stochasticity"][agent] += each
            columns["stochastic_states"][agent] += 1.0
    return columns


def _discrete(episode: EpisodeData, agent: int) -> list[float]:
    """Return the entropy / log(number of allowed actions) in each state with a choice."""
    decisions = episode.decisions(agent)
    by_lane = decisions.action == ActionSpaceType.Lane
    action_mask = dict(
        zip(decisions.step[by_lane].tolist(), decisions.action_mask[by_lane].tolist(), strict=True)
    )
    found = []
    for step, probabilities in episode.extras(agent, PROBABILITIES).items():
        choices = len(probabilities)
        if step in action_mask and choices == len(LaneAction):
            choices = int(action_mask[step] & 0xF).bit_count()
        if choices > 1:
            kept = probabilities[probabilities > 0.0]
            found.append(float(-(kept * np.log(kept)).sum() / np.log(choices)))
    return found


def _continuous(episode: EpisodeData, agent: int) -> list[float]:
    return [min(float(np.mean(std)), 1.0) for std in episode.extras(agent, DEVIATION).values()]


METRIC = ratio(
    "stochasticity",
    "stochastic_states",
    name="stochasticity",
    label="Stochasticity",
    meaning="mean over visited states of the entropy of the sampling distribution / log(allowed actions); "
    "of continuous actions, the standard deviation / half range, cut at 1",
    measure=measure,
    counted="states",
    missing="no distribution was recorded, as of rule-based policies",
)
