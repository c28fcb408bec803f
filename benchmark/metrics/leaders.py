"""Leaders and followers along planned paths, and times to collision."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from benchmark.metrics.episode_data import EpisodeData, Lanes, Paths, VehicleTracks
from smarts.geometry.compiling import kernel

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]


def time_to_collision(episode: EpisodeData) -> Floats:
    """Return each agent's time to collision with the vehicles ahead, at constant speeds [s].

    Along the agent's planned path, with those whose centre is on one of its lanes, or whose footprint reaches
    from the lane beside into the strip that the agent's covers. An agent beside its lane is taken to go
    straight on.

    Returns:
        Shape (T, A): infinite where nothing closes in, 0 for overlapping strips, NaN where it does not drive.
    """
    times = np.full(episode.driving.shape, np.nan)
    for agent in np.flatnonzero(episode.own >= 0).tolist():
        own = int(episode.own[agent])
        _times(episode.motion, episode.paths, episode.lanes, own, episode.driving[:, agent], times[:, agent])
    return times


@kernel
def _times(
    motion: VehicleTracks, paths: Paths, lanes: Lanes, own: int, driving: NDArray[np.bool_], out: Floats
) -> None:
    for k in range(len(driving)):
        if not (driving[k] and motion.present[k, own]):
            continue
        lane = motion.lane[k, own]
        is_off = lane < 0 or abs(motion.t[k, own]) > lanes.width[lane] / 2
        out[k] = math.inf
        for other in range(motion.present.shape[1]):
            if other == own or not motion.present[k, other]:
                continue
            if is_off:
                time = _time_straight(motion, own, other, k)
            else:
                time = _time_along(motion, paths, lanes, own, other, k)
            out[k] = min(out[k], time)


@kernel
def _time_along(motion: VehicleTracks, paths: Paths, lanes: Lanes, own: int, other: int, k: int) -> float:
    ahead, aside = place_ahead(motion, paths, lanes, own, other, k)
    if not ahead > 0.0:
        return math.inf
    beside = abs(aside + motion.t[k, other] - motion.t[k, own])
    if aside != 0.0 and beside >= (motion.width[own] + motion.width[other]) / 2:
        return math.inf
    closing = motion.speed[k, own] - motion.speed[k, other] * math.cos(motion.turn[k, other])
    gap = ahead - (motion.length[own] + motion.length[other]) / 2
    if closing <= 0.0:
        return math.inf
    return max(gap, 0.0) / closing


@kernel
def _time_straight(motion: VehicleTracks, own: int, other: int, k: int) -> float:
    cosine, sine = math.cos(motion.heading[k, own]), math.sin(motion.heading[k, own])
    dx, dy = motion.x[k, other] - motion.x[k, own], motion.y[k, other] - motion.y[k, own]
    ahead, beside = dx * cosine + dy * sine, dy * cosine - dx * sine
    turn = motion.heading[k, other] - motion.heading[k, own]
    along, across = abs(math.cos(turn)), abs(math.sin(turn))
    length = along * motion.length[other] + across * motion.width[other]
    width = along * motion.width[other] + across * motion.length[other]
    if ahead <= 0.0 or abs(beside) >= (motion.width[own] + width) / 2:
        return math.inf
    closing = motion.speed[k, own] - motion.speed[k, other] * math.cos(turn)
    if closing <= 0.0:
        return math.inf
    return max(ahead - (motion.length[own] + length) / 2, 0.0) / closing


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
