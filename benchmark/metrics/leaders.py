"""Leaders and followers along planned paths."""

from __future__ import annotations

import math

from benchmark.metrics.episode_data import Lanes, Paths, VehicleTracks
from smarts.geometry.compiling import kernel


@kernel
def place_ahead(
    motion: VehicleTracks, paths: Paths, lanes: Lanes, own: int, other: int, k: int
) -> tuple[float, float]:
    """Return how far a vehicle's centre is ahead of another's along the latter's path [m], and aside.

    Aside is how far its lane's middle lies to the left of the path's lane [m]: 0 on the same lane. Only the
    lanes of a road that lie directly beside each other count. NaN and 0 where it is not on the path.
    """
    path, lane = motion.path[k, own], motion.lane[k, other]
    if path < 0 or lane < 0:
        return math.nan, 0.0
    for row in range(paths.lane.shape[1]):
        each = paths.lane[path, row]
        if each < 0:
            break
        if each == lane:
            return paths.begin[path, row] + motion.s[k, other] - motion.s[k, own], 0.0
        if lanes.left[each] == lane or lanes.right[each] == lane:
            aside = (lanes.width[each] + lanes.width[lane]) / 2
            aside = float(aside) if lanes.left[each] == lane else -float(aside)
            return paths.begin[path, row] + motion.s[k, other] - motion.s[k, own], aside
    return math.nan, 0.0


@kernel
def distance_ahead(motion: VehicleTracks, paths: Paths, lanes: Lanes, own: int, other: int, k: int) -> float:
    """Return how far a vehicle is ahead of another along the roads that either plans to take [m].

    Below 0 where it is behind; lanes side by side count as one road. NaN where neither is on the other's way.
    """
    if not (motion.present[k, own] and motion.present[k, other]):
        return math.nan
    ahead = _along_roads(motion, paths, lanes, own, other, k)
    return ahead if math.isfinite(ahead) else -_along_roads(motion, paths, lanes, other, own, k)


@kernel
def _along_roads(motion: VehicleTracks, paths: Paths, lanes: Lanes, own: int, other: int, k: int) -> float:
    path, lane = motion.path[k, own], motion.lane[k, other]
    if path < 0 or lane < 0:
        return math.nan
    for row in range(paths.lane.shape[1]):
        each = paths.lane[path, row]
        if each < 0:
            break
        if lanes.edge[each] == lanes.edge[lane]:
            return paths.begin[path, row] + motion.s[k, other] - motion.s[k, own]
    return math.nan


@kernel
def leader_of(motion: VehicleTracks, paths: Paths, lanes: Lanes, own: int, k: int) -> tuple[int, float]:
    """Return the nearest vehicle ahead on a vehicle's path, -1 for none, and how far it is [m]."""
    best, nearest = -1, math.inf
    if not motion.present[k, own]:
        return best, nearest
    for other in range(motion.present.shape[1]):
        if other == own or not motion.present[k, other]:
            continue
        ahead, aside = place_ahead(motion, paths, lanes, own, other, k)
        if aside == 0.0 and 0.0 < ahead < nearest:
            best, nearest = other, ahead
    return best, nearest


@kernel
def follower_of(motion: VehicleTracks, paths: Paths, lanes: Lanes, own: int, k: int) -> tuple[int, float]:
    """Return the nearest vehicle behind whose path leads to a vehicle, -1 for none, and how far [m]."""
    best, nearest = -1, math.inf
    for other in range(motion.present.shape[1]):
        if other == own or not motion.present[k, other]:
            continue
        ahead, aside = place_ahead(motion, paths, lanes, other, own, k)
        if aside == 0.0 and 0.0 < ahead < nearest:
            best, nearest = other, ahead
    return best, nearest
