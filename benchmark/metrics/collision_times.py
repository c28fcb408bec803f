"""Times to collision along planned paths: crossing and merging vehicles count as well as those ahead."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmark.metrics.episode_data import EpisodeData, Lanes, Paths, VehicleTracks
from smarts.geometry.boxes import box_gaps
from smarts.geometry.compiling import kernel
from smarts.types.agent_states import ChangePhase

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]

HORIZON = 3.0
"""How far motion is predicted [s]."""
INTERVAL = 0.1
"""Between predicted instants [s]."""
_STEPS = round(HORIZON / INTERVAL)
_CHANGING = (ChangePhase.REQUESTED, ChangePhase.MOVING)


class Map(NamedTuple):
    """Lanes and their centrelines."""

    lanes: Lanes
    start: Ints
    """Row of `xy` at which each lane begins, shape (L + 1,)."""
    xy: Floats
    """[m], shape (P, 2)."""
    s: Floats
    """Arc length of each point [m], shape (P,)."""


def time_to_collision(episode: EpisodeData) -> Floats:
    """Return each agent's time to collision with any vehicle at its decisions [s].

    It is the earliest overlap of the two footprints if both continue along their planned paths at present
    speeds and lateral offsets. An agent that changes lanes is predicted in the middle of its target lane. A
    vehicle whose centre is beside its lane, or that faces against it, is predicted straight ahead. An agent
    without recorded decisions is measured at every instant.

    Returns:
        Shape (T, A): multiples of 0.1 s, infinite where nothing overlaps within 3 s, NaN where the agent
        makes no decision or does not drive.
    """
    graph, targets = episode.graph, _target_lanes(episode)
    where = Map(episode.lanes, graph.point_start, graph.point_xy, graph.point_s)
    times = np.full(episode.driving.shape, np.nan)
    for agent in np.flatnonzero(episode.own >= 0).tolist():
        is_due = episode.driving[:, agent].copy()
        steps = episode.decisions(agent).step
        if len(steps):
            decides = np.zeros_like(is_due)
            decides[steps] = True
            is_due &= decides
        _times(
            episode.motion, episode.paths, where, targets, int(episode.own[agent]), is_due, times[:, agent]
        )
    return times


def _target_lanes(episode: EpisodeData) -> Ints:
    """Return the lane into which each vehicle is changing, -1 for none, shape (T, V)."""
    targets = np.full(episode.motion.lane.shape, -1, np.int32)
    phase, lane = episode.agent_column("change_phase"), episode.agent_column("target_lane")
    for agent in np.flatnonzero(episode.own >= 0).tolist():
        is_changing = np.isin(phase[:, agent], _CHANGING)
        targets[is_changing, episode.own[agent]] = lane[is_changing, agent].astype(np.int32)
    return targets


@kernel
def _times(
    motion: VehicleTracks,
    paths: Paths,
    where: Map,
    targets: Ints,
    own: int,
    is_due: NDArray[np.bool_],
    out: Floats,
) -> None:
    for k in range(len(is_due)):
        if not (is_due[k] and motion.present[k, own]):
            continue
        first = _STEPS + 1
        for other in range(motion.present.shape[1]):
            if other != own and motion.present[k, other]:
                first = min(first, _first_overlap(motion, paths, where, targets, own, other, k, first))
        out[k] = first * INTERVAL if first <= _STEPS else math.inf


@kernel
def _first_overlap(
    motion: VehicleTracks, paths: Paths, where: Map, targets: Ints, own: int, other: int, k: int, before: int
) -> int:
    """Return the first predicted instant at which two footprints overlap, `before` without one."""
    speed, speed2 = abs(motion.speed[k, own]), abs(motion.speed[k, other])
    reach = (motion.length[own] + motion.length[other] + motion.width[own] + motion.width[other]) / 2
    # While lanes are changed, a footprint is predicted up to a lane aside.
    lane_width = 5.0
    gap = math.hypot(motion.x[k, other] - motion.x[k, own], motion.y[k, other] - motion.y[k, own])
    if gap > reach + lane_width + (speed + speed2) * HORIZON:
        return before
    for number in range(before):
        seconds = number * INTERVAL
        pose = _predicted(motion, paths, where, targets, own, k, seconds)
        pose2 = _predicted(motion, paths, where, targets, other, k, seconds)
        if math.hypot(pose2[0] - pose[0], pose2[1] - pose[1]) > reach:
            continue
        gaps = box_gaps(
            pose,
            motion.length[own] / 2,
            motion.width[own] / 2,
            pose2,
            motion.length[other] / 2,
            motion.width[other] / 2,
        )
        if max(max(gaps[0], gaps[1]), max(gaps[2], gaps[3])) < 0.0:
            return number
    return before


@kernel
def _predicted(
    motion: VehicleTracks, paths: Paths, where: Map, targets: Ints, vehicle: int, k: int, seconds: float
) -> tuple[float, float, float]:
    """Return where a vehicle's centre will be, and its heading."""
    x, y, heading = motion.x[k, vehicle], motion.y[k, vehicle], motion.heading[k, vehicle]
    if seconds == 0.0:
        return x, y, heading
    distance = motion.speed[k, vehicle] * seconds
    lane, path = motion.lane[k, vehicle], motion.path[k, vehicle]
    is_off = lane < 0 or path < 0 or abs(motion.t[k, vehicle]) > where.lanes.width[lane] / 2
    if is_off or abs(motion.turn[k, vehicle]) > np.pi / 2:
        return x + distance * math.cos(heading), y + distance * math.sin(heading), heading
    place, row = motion.s[k, vehicle] + distance, 0
    while row + 1 < paths.lane.shape[1] and paths.lane[path, row + 1] >= 0:
        if place < paths.begin[path, row + 1]:
            break
        row += 1
    offset = _offset(motion, where.lanes, targets[k, vehicle], vehicle, k)
    return _pose(where, paths.lane[path, row], place - paths.begin[path, row], offset)


@kernel
def _offset(motion: VehicleTracks, lanes: Lanes, target: int, vehicle: int, k: int) -> float:
    """Return the offset that a vehicle is predicted to hold from the middle of its present lane [m]."""
    lane = motion.lane[k, vehicle]
    if target < 0:
        return float(motion.t[k, vehicle])
    if target == lane:
        return 0.0
    if lanes.left[lane] == target:
        return float((lanes.width[lane] + lanes.width[target]) / 2)
    if lanes.right[lane] == target:
        return float(-(lanes.width[lane] + lanes.width[target]) / 2)
    return float(motion.t[k, vehicle])


@kernel
def _pose(where: Map, lane: int, s: float, t: float) -> tuple[float, float, float]:
    """Return a place beside a lane's centreline and the line's heading; straight on beyond its end."""
    first, last = where.start[lane], where.start[lane + 1] - 1
    row = first + int(np.searchsorted(where.s[first : last + 1], s, side="right")) - 1
    row = min(max(row, first), last - 1)
    dx, dy = where.xy[row + 1, 0] - where.xy[row, 0], where.xy[row + 1, 1] - where.xy[row, 1]
    length = math.hypot(dx, dy)
    along = s - where.s[row]
    x = where.xy[row, 0] + (dx * along - dy * t) / length
    y = where.xy[row, 1] + (dy * along + dx * t) / length
    return x, y, math.atan2(dy, dx)
