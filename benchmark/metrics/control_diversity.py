"""Control diversity: whether a policy acts by speed, by steering, or by both."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from benchmark.metrics.episode_data import Decisions, EpisodeData
from benchmark.metrics.measure import Columns, Floats, Totals, ratio, share
from smarts.types.actions import ActionSpaceType, LaneAction

LEAST_COMMANDS = 20
"""Of an agent-episode that counts."""
LEAST_AGENTS = 10
"""That gave so many, for a mean."""
ACCELERATION = 0.3
"""Above which a change of speed is a command [m/s^2]."""
STEERING_RATE = np.radians(2.0)
"""Above which steering is a command [rad/s]."""

Bools = NDArray[np.bool_]


def measure(episode: EpisodeData) -> Columns:
    """Return the entropy of the split of each agent's commands, and how the commands split."""
    columns = {name: np.zeros(episode.count) for name in METRIC.columns}
    for agent in np.flatnonzero(episode.entered).tolist():
        decisions = episode.decisions(agent)
        if not len(decisions.step):
            continue
        along, across = _commands(episode, agent, decisions)
        total = np.count_nonzero(along | across)
        if total < LEAST_COMMANDS:
            continue
        both = np.count_nonzero(along & across)
        longitudinal = np.count_nonzero(along) - both / 2
        columns["control_diversity"][agent] = split_entropy(longitudinal / total)
        columns["controlling_agents"][agent] = 1.0
        columns["longitudinal_commands"][agent] = longitudinal
        columns["lateral_commands"][agent] = total - longitudinal
    return columns


def _commands(episode: EpisodeData, agent: int, decisions: Decisions) -> tuple[Bools, Bools]:
    """Return which decisions command speed, and which steering; where both, each counts half."""
    kind = int(decisions.action[0])
    choice = decisions.values[:, 0]
    if kind == ActionSpaceType.Lane:
        changes = np.isin(choice, (LaneAction.change_lane_left, LaneAction.change_lane_right))
        return choice == LaneAction.slow_down, changes & decisions.is_effective
    if kind == ActionSpaceType.LaneWithContinuousSpeed:
        rate = np.diff(choice, prepend=choice[:1]) / _spans(episode, decisions)
        return np.abs(rate) > ACCELERATION, (np.abs(decisions.values[:, 1]) > 0.5) & decisions.is_effective
    return _driven(episode, agent, decisions)


def _driven(episode: EpisodeData, agent: int, decisions: Decisions) -> tuple[Bools, Bools]:
    """Return the commands of other actions as carried out: by the change of speed and of steering."""
    last = int(episode.agents["end_step"][agent])
    ends = np.minimum(np.append(decisions.step[1:], last), last)
    spans = np.maximum(ends - decisions.step, 1) * episode.dt
    speed = episode.motion.speed[:, episode.own[agent]]
    steering = episode.agent_column("steering")[:, agent]
    faster = np.abs(speed[ends] - speed[decisions.step]) / spans > ACCELERATION
    turned = np.abs(steering[ends] - steering[decisions.step]) / spans > STEERING_RATE
    return faster, turned


def _spans(episode: EpisodeData, decisions: Decisions) -> Floats:
    """Return the time since the decision before [s]."""
    spans = np.diff(decisions.step, prepend=decisions.step[:1] - 1).astype(float)
    return np.maximum(spans, 1.0) * episode.dt


def split_entropy(part: float) -> float:
    """Return the entropy of a split into two, 1 for halves."""
    parts = np.array([part, 1.0 - part])
    parts = parts[parts > 0.0]
    return float(-(parts * np.log2(parts)).sum())


def terms(totals: Totals) -> Mapping[str, Floats]:
    """Return the preference: the two shares of all commands."""
    total = totals["longitudinal_commands"] + totals["lateral_commands"]
    return {
        "longitudinal_share": share(totals["longitudinal_commands"], total),
        "lateral_share": share(totals["lateral_commands"], total),
    }


METRIC = ratio(
    "control_diversity",
    "controlling_agents",
    columns=(
        "longitudinal_commands",
        "lateral_commands",
    ),
    name="control_diversity",
    label="Control diversity",
    meaning="entropy of the split between longitudinal and lateral commands / log 2",
    measure=measure,
    counted="agent-episodes with 20 commands",
    least=LEAST_AGENTS,
    missing=f"fewer than {LEAST_AGENTS} agent-episodes with {LEAST_COMMANDS} commands",
    is_axis=True,
    terms=terms,
)
