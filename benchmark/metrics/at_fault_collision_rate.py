"""At-fault collision rate: the share of agent-episodes that a collision ends for which the agent answers."""

from __future__ import annotations

import enum

import numpy as np

from benchmark.metrics.encounters import find_encounters
from benchmark.metrics.episode_data import EpisodeData
from benchmark.metrics.extras import CAUSE_HEADWAY, CAUSE_TIME, HARD
from benchmark.metrics.lane_changes import find_lane_changes, is_within_lane
from benchmark.metrics.leaders import leader_of, place_ahead
from benchmark.metrics.measure import Columns, ended_by, ratio
from smarts.roads.lane_graph import Yields
from smarts.types.events import Outcome

STILL = 0.1
"""Below which the vehicle stands [m/s]."""
STOOD = 1.0
"""For how long it must have stood [s]."""
RECENT = 2.0
"""Before the collision, a lane change or a hard brake is a cause of it for so long [s]."""

_FRONT, _LEFT, _REAR, _RIGHT = range(4)  # column `side` of the table `agents`


class Fault(enum.IntEnum):
    """Why an agent is at fault or not; the first two mean that it is not."""

    STOOD = 0
    """It had stood for 1 s."""
    STRUCK_FROM_BEHIND = 1
    """By a vehicle behind in its lane."""
    ON_A_LINE = 2
    """Its footprint was not wholly in its lane."""
    FRONT = 3
    """Its front ran into what was ahead."""
    CUT_IN = 4
    """Struck from behind less than 2 s after it had changed into the lane."""
    HARD_BRAKE = 5
    """Struck from behind as it braked hard, without a leader or a conflict."""
    NO_PRIORITY = 6
    """It entered a conflict in which it had to give way."""
    SIDE = 7
    """Any other contact of its side: both are at fault."""
    UNCLASSIFIED = 8


def fault_of(episode: EpisodeData, agent: int) -> Fault:
    """Return the fault of an agent whose episode ended by a collision.

    What was before it is that of the instant before the step of the contact. A lane's outer sides are lines,
    too; inside junctions there are none.
    """
    motion, lanes, own = episode.motion, episode.lanes, int(episode.own[agent])
    end, side = int(episode.agents["end_step"][agent]), int(episode.agents["side"][agent])
    before = max(end - 1, int(episode.agents["entry_step"][agent]))
    since = end - round(STOOD / episode.dt)
    if since >= 0 and (np.abs(motion.speed[since:end, own]) < STILL).all():
        return Fault.STOOD
    lane = motion.lane[before, own]
    if lane >= 0 and not episode.graph.is_internal[lane] and not is_within_lane(motion, lanes, own, before):
        return Fault.ON_A_LINE
    if side == _FRONT:
        return Fault.FRONT
    other = int(episode.partner[agent])
    if other >= 0 and side == _REAR:
        ahead, aside = place_ahead(motion, episode.paths, lanes, other, own, before)
        if ahead > 0.0 and aside == 0.0:
            return _struck_from_behind(episode, agent, end)
    if other >= 0 and _has_to_give_way(episode, lane, motion.lane[before, other]):
        return Fault.NO_PRIORITY
    return Fault.SIDE if side in (_LEFT, _RIGHT) else Fault.UNCLASSIFIED


def _struck_from_behind(episode: EpisodeData, agent: int, end: int) -> Fault:
    recent = range(max(0, end - round(RECENT / episode.dt) + 1), end)
    if episode.shared(find_lane_changes).settled[recent, agent].any():
        return Fault.CUT_IN
    motion, own = episode.motion, int(episode.own[agent])
    hard = (k for k in recent if episode.driving[k, agent] and motion.acceleration[k, own] < -HARD)
    has_no_cause = any(not _has_cause(episode, agent, k) for k in hard)
    return Fault.HARD_BRAKE if has_no_cause else Fault.STRUCK_FROM_BEHIND


def _has_cause(episode: EpisodeData, agent: int, k: int) -> bool:
    """Return whether an agent that brakes hard is near a leader, or has just met another in a conflict."""
    motion, own = episode.motion, int(episode.own[agent])
    leader, ahead = leader_of(motion, episode.paths, episode.lanes, own, k)
    if leader >= 0:
        speed = motion.speed[k, own]
        gap = ahead - (motion.length[own] + motion.length[leader]) / 2
        if gap <= speed * CAUSE_HEADWAY + speed**2 / (2 * HARD):
            return True
    encounters = episode.shared(find_encounters)
    since = (k - encounters.step) * episode.dt
    return bool(((encounters.agent == agent) & (since >= 0) & (since <= CAUSE_TIME)).any())


def _has_to_give_way(episode: EpisodeData, lane: int, other: int) -> bool:
    """Return whether the traffic of a lane has to give way to that of another which it meets."""
    if lane < 0:
        return False
    graph = episode.graph
    rows = slice(graph.conflict_start[lane], graph.conflict_start[lane + 1])
    yields = graph.conflict_yields[rows][graph.conflict_lane[rows] == other]
    return bool(np.isin(yields, (Yields.THIS, Yields.BOTH)).any())


def measure(episode: EpisodeData) -> Columns:
    """Return collisions at fault, and those of them that no rule classifies."""
    faults = np.full(episode.count, -1)
    for agent in np.flatnonzero(ended_by(episode, Outcome.COLLISION)).tolist():
        faults[agent] = fault_of(episode, agent)
    return {
        "at_fault_collisions": (faults > Fault.STRUCK_FROM_BEHIND).astype(float),
        "unclassified_collisions": (faults == Fault.UNCLASSIFIED).astype(float),
    }


METRIC = ratio(
    "at_fault_collisions",
    is_count=True,
    columns=("unclassified_collisions",),
    name="at_fault_collision_rate",
    label="At-fault collision rate",
    meaning="share of agent-episodes that end by a collision at fault",
    measure=measure,
    terms=lambda totals: {"unclassified": totals["unclassified_collisions"]},
    missing="no agent took part",
    better="lower",
)
