"""Control diversity: whether a policy acts by speed, by steering, or by both."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from benchmark.metrics.episode_data import Decisions, EpisodeData
from benchmark.metrics.measure import Columns, Floats, Measure, Totals, share
from smarts.types.actions import ActionSpaceType, LaneAction

LEAST_COMMANDS = 50
"""Commands that all agent-episodes of a checkpoint and cell must have together."""
ACCELERATION = 0.3
"""Above which a change of speed is a command [m/s^2]."""
STEERING_RATE = np.radians(2.0)
"""Above which steering is a command [rad/s]."""

Bools = NDArray[np.bool_]


def measure(episode: EpisodeData) -> Columns:
    """Return how many of each agent's commands were longitudinal and lateral, and how far it drove."""
    columns = {name: np.zeros(episode.count) for name in METRIC.columns}
    for agent in np.flatnonzero(episode.entered).tolist():
        decisions = episode.decisions(agent)
        if not len(decisions.step):
            continue
        along, across = _commands(episode, agent, decisions)
        both = np.count_nonzero(along & across)
        columns["speed_commands"][agent] = np.count_nonzero(along) - both / 2
        columns["steering_commands"][agent] = np.count_nonzero(across) - both / 2
        columns["command_metres"][agent] = episode.agents["distance_travelled"][agent]
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


def split_entropy(part: Floats) -> Floats:
    """Return the entropy of a split into two, 1 for halves, NaN where the part is."""
    parts = np.stack([part, 1.0 - np.asarray(part)])
    logarithms = np.log2(np.where(parts > 0.0, parts, 1.0))
    return -(parts * logarithms).sum(axis=0)


def terms(totals: Totals) -> Mapping[str, Floats]:
    """Return the preference, which is the two shares of all commands, and commands per 100 m."""
    total = totals["speed_commands"] + totals["steering_commands"]
    return {
        "longitudinal_share": share(totals["speed_commands"], total),
        "lateral_share": share(totals["steering_commands"], total),
        "commands_per_100_m": share(100.0 * total, totals["command_metres"]),
    }


METRIC = Measure(
    name="control_diversity",
    label="Control diversity",
    meaning="entropy of the split between longitudinal and lateral commands of all agent-episodes / log 2",
    columns=("speed_commands", "steering_commands", "command_metres"),
    measure=measure,
    value=lambda totals: split_entropy(terms(totals)["longitudinal_share"]),
    count=("speed_commands", "steering_commands"),
    counted="commands",
    least=LEAST_COMMANDS,
    missing=f"fewer than {LEAST_COMMANDS} commands of a checkpoint",
    is_axis=True,
    terms=terms,
    is_of_checkpoints=True,
)
