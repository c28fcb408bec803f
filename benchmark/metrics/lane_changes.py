"""Completed lane changes: from wholly in one lane to wholly in the one beside it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmark.metrics.episode_data import EpisodeData, Lanes, Paths, VehicleTracks
from benchmark.metrics.leaders import follower_of
from smarts.geometry.compiling import kernel

Bools = NDArray[np.bool_]

HEADWAY = 1.0
"""Below which the vehicle behind has been cut in on [s]."""
LEAST_SPEED = 1.0
"""Speed of the vehicle behind from which a cut-in counts [m/s]."""
TOLERANCE = 1e-6
"""By which a footprint may be over the line [m]; against rounding."""


class FoundLaneChanges(NamedTuple):
    """The lane changes of all agents."""

    completed: NDArray[np.int32]
    """Shape (A,)."""
    cut_ins: NDArray[np.int32]
    """Those after which the vehicle behind had a headway below 1 s, shape (A,)."""
    under_way: Bools
    """When an agent was between the two lanes of a completed change, shape (T, A)."""
    settled: Bools
    """When it was first wholly in the new lane, shape (T, A)."""


def find_lane_changes(episode: EpisodeData) -> FoundLaneChanges:
    """Return the lane changes of all agents, whatever action led to them."""
    count, instants = episode.count, (episode.steps + 1, episode.count)
    found = FoundLaneChanges(
        completed=np.zeros(count, np.int32),
        cut_ins=np.zeros(count, np.int32),
        under_way=np.zeros(instants, np.bool_),
        settled=np.zeros(instants, np.bool_),
    )
    for agent in np.flatnonzero(episode.own >= 0).tolist():
        found.completed[agent], found.cut_ins[agent] = _changes(
            episode.motion,
            episode.paths,
            episode.lanes,
            int(episode.own[agent]),
            episode.driving[:, agent],
            found.under_way[:, agent],
            found.settled[:, agent],
        )
    return found


@kernel
def _changes(
    motion: VehicleTracks,
    paths: Paths,
    lanes: Lanes,
    own: int,
    driving: Bools,
    under_way: Bools,
    settled: Bools,
) -> tuple[int, int]:
    completed, cut_ins = 0, 0
    # The lane that it was last wholly in, or the one that this has led into; when that was.
    home, since = -1, 0
    for k in range(len(driving)):
        lane = motion.lane[k, own]
        if not driving[k] or lane < 0:
            continue
        if home >= 0 and lanes.edge[lane] != lanes.edge[home]:
            home = _beside(motion, paths, lanes, own, k, since, home, lane)
        if not is_within_lane(motion, lanes, own, k):
            continue
        if home >= 0 and home != lane and lanes.edge[home] == lanes.edge[lane]:
            completed += 1
            under_way[since + 1 : k] = True
            settled[k] = True
            cut_ins += _is_cut_in(motion, paths, lanes, own, k)
        home, since = lane, k
    return completed, cut_ins


@kernel
def is_within_lane(motion: VehicleTracks, lanes: Lanes, own: int, k: int) -> bool:
    """Return whether the footprint lies wholly in its lane, across."""
    turn = motion.turn[k, own]
    reach = abs(math.sin(turn)) * motion.length[own] / 2 + abs(math.cos(turn)) * motion.width[own] / 2
    return abs(motion.t[k, own]) + reach <= lanes.width[motion.lane[k, own]] / 2 + TOLERANCE


@kernel
def _beside(
    motion: VehicleTracks, paths: Paths, lanes: Lanes, own: int, k: int, since: int, home: int, lane: int
) -> int:
    """Return where the lane that it left leads to beside the one it is on, -1 where that is not known."""
    path = motion.path[since, own]
    if path < 0:
        return -1
    for row in range(paths.lane.shape[1]):
        each = paths.lane[path, row]
        if each >= 0 and lanes.edge[each] == lanes.edge[lane]:
            return int(each)
    return -1


@kernel
def _is_cut_in(motion: VehicleTracks, paths: Paths, lanes: Lanes, own: int, k: int) -> bool:
    behind, distance = follower_of(motion, paths, lanes, own, k)
    if behind < 0 or motion.speed[k, behind] <= LEAST_SPEED:
        return False
    gap = distance - (motion.length[own] + motion.length[behind]) / 2
    return gap / motion.speed[k, behind] < HEADWAY
