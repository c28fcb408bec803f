"""Waypoint paths: the lanes ahead as points at equal distances."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from smarts.arrays import Floats, Ints
from smarts.geometry.compiling import kernel
from smarts.geometry.frames import FARTHEST
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.kernels import centre_at, lane_length, nearest_segment, pose_on_lane
from smarts.roads.lane_ways import row_of


class WaypointPaths(NamedTuple):
    """Room for the paths of a vehicle: at most K paths of at most W waypoints each.

    A vehicle's paths begin beside it, one in each lane of its road (inside a junction, in each of the lanes
    that connect the same two roads, or with a route, that connect the route's road before with the one
    behind), from the right to the left. Waypoint i lies i * spacing metres of centreline ahead of the
    vehicle's foot on that lane, through junctions along the route. A path

    - forks where its lane leads into several lanes that follow the route (without a route: into several
      lanes): the branch to the first lane continues the path, the others become separate paths with the same
      first waypoints;
    - ends, with a smaller count, where its lane leaves the route, at the end of the route's last road, and at
      a dead end;
    - is left out where there are more than K: first come the paths of the vehicle's own lane, then those of
      the other lanes, the nearest first. Those that are kept stay in their order.

    A vehicle that is off its route gets the paths of its road without a route; one that is nowhere gets none.
    """

    length: Ints
    """Waypoints of each path, shape (K,)."""
    point: Floats
    """Waypoints: x, y [m], heading [rad], lane in all maps, arc length along it [m], shape (K, W, 5)."""

    @classmethod
    def allocate(cls, paths: int, lookahead: int) -> WaypointPaths:
        """Return room for K paths of W waypoints."""
        return cls(np.zeros(paths, np.int32), np.zeros((paths, lookahead, 5)))


@kernel
def foot(roads: Roads, lane: int, x: float, y: float, height: float) -> float:
    """Return the arc length of the point of a lane's centreline that is nearest to a position [m]."""
    return foot_between(roads, roads.point_start[lane], roads.point_start[lane + 1] - 2, x, y, height)


@kernel
def foot_between(roads: Roads, first: int, last: int, x: float, y: float, height: float) -> float:
    """Return `foot` of a position on those segments of a lane that begin at points `first` to `last`."""
    best, best_share, _, _ = nearest_segment(roads, first, last, x, y, height)
    span = roads.point_s[best + 1] - roads.point_s[best]
    return float(roads.point_s[best] + min(1.0, max(0.0, best_share)) * span)


@kernel
def _start(roads: Roads, table: RouteTable, row: int, x: float, y: float, height: float) -> float:
    """Return where on a row's lane a path beside the vehicle begins [m], or -1 if it begins on another row.

    A way through a junction may have two lanes, one after the other; the path begins on the second as soon as
    the vehicle is past its first point.
    """
    s = foot(roads, table.lane[row], x, y, height)
    if table.before[row] >= 0 and s == 0.0:
        return -1.0
    for entry in range(table.onward_start[row], table.onward_start[row + 1]):
        following = table.onward[entry]
        if table.before[following] == row and foot(roads, table.lane[following], x, y, height) > 0.0:
            return -1.0
    return s


@kernel
def _follow(
    roads: Roads,
    table: RouteTable,
    row: int,
    s: float,
    spacing: float,
    first_path: int,
    limit: int,
    paths: WaypointPaths,
) -> tuple[int, int]:
    """Write the paths that begin at `s` of a row as far as they fit.

    Returns the number of paths after them, at most `limit`, and how many branches were left out.

    `forks` are branches still to follow: row, first waypoint, path that it copies, arc length. They are a
    stack that forgets its oldest branches where it is full: each branch followed is a path, so there is no
    room for what is forgotten.
    """
    most, lookahead, _ = paths.point.shape
    forks = np.empty((max(1, most), 4))
    forks[0, 0], forks[0, 1], forks[0, 2], forks[0, 3] = row, 0, -1, s
    open_forks, path = 1, first_path
    while open_forks > 0 and path < limit:
        open_forks -= 1
        fork = forks[open_forks % len(forks)]
        row, i, parent, s = int(fork[0]), int(fork[1]), int(fork[2]), fork[3]
        paths.point[path, :i] = paths.point[parent, :i]
        while row >= 0:
            i, s = walk_lane(roads, table.lane[row], s, i, spacing, paths.point[path])
            if i == lookahead:
                break
            first, last = table.onward_start[row], table.onward_start[row + 1]
            for entry in range(last - 1, first, -1):
                fork = forks[open_forks % len(forks)]
                fork[0], fork[1], fork[2], fork[3] = table.onward[entry], i, path, s
                open_forks += 1
            row = int(table.onward[first]) if last > first else -1
        paths.length[path] = i
        path += 1
    return path, open_forks


@kernel
def _follow_own_lane_first(
    roads: Roads,
    table: RouteTable,
    group: tuple[int, int],
    own: int,
    place: tuple[float, float, float],
    mask: int,
    spacing: float,
    paths: WaypointPaths,
) -> tuple[int, int]:
    """Write the paths of a group of rows that has too many; see `WaypointPaths` for which are kept.

    Args:
        roads: The maps' lanes.
        table: The routes.
        group: The group's first row, and the one after its last.
        own: The row that the vehicle is on.
        place: The vehicle's x, y, height [m].
        mask: Bit k is set if lanes of kind k have paths.
        spacing: Between waypoints [m].
        paths: Written.

    Returns:
        The number of paths, and how many branches were left out.
    """
    first, last = group
    begin, away = np.full(last - first, -1.0), np.full(last - first, np.inf)
    kept = np.zeros(last - first, np.int32)
    for row in range(first, last):
        lane = table.lane[row]
        if mask >> roads.lane_kind[lane] & 1:
            begin[row - first] = s = _start(roads, table, row, *place)
            if s >= 0.0:
                x, y, _ = pose_on_lane(roads, lane, s)
                away[row - first] = -1.0 if row == own else math.hypot(x - place[0], y - place[1])
    room, left_out = len(paths.length), 0
    for number in np.argsort(away, kind="mergesort"):
        if begin[number] >= 0.0:
            row = first + number
            kept[number], missing = _follow(roads, table, row, begin[number], spacing, 0, room, paths)
            room -= kept[number]
            left_out += missing
    count = 0
    for number in range(last - first):
        if kept[number] > 0:
            row, limit = first + number, count + kept[number]
            count, _ = _follow(roads, table, row, begin[number], spacing, count, limit, paths)
    return count, left_out


@kernel
def _group_of(table: RouteTable, row: int) -> tuple[int, int]:
    """Return the first row of a row's group, and the one after its last."""
    first, last = row, row + 1
    while first > 0 and table.group[first - 1] == table.group[row]:
        first -= 1
    while last < len(table.group) and table.group[last] == table.group[row]:
        last += 1
    return first, last


@kernel
def walk_lane(roads: Roads, lane: int, s: float, i: int, spacing: float, points: Floats) -> tuple[int, float]:
    """Write waypoints from `s` to the lane's end; return the next one's number and its overhang [m]."""
    point, last_point = roads.point_start[lane], roads.point_start[lane + 1] - 2
    length = lane_length(roads, lane)
    while i < len(points) and s <= length:
        while point < last_point and roads.point_s[point + 1] <= s:
            point += 1
        points[i, 0], points[i, 1], points[i, 2] = centre_at(roads, point, s)
        points[i, 3], points[i, 4] = lane, s
        i += 1
        s += spacing
    return i, s - length


@kernel
def write_waypoints(
    roads: Roads,
    table: RouteTable,
    m: int,
    place: tuple[float, float, float],
    lane: int,
    route: int,
    hint: float,
    mask: int,
    spacing: float,
    paths: WaypointPaths,
) -> tuple[int, int]:
    """Write the waypoint paths of a vehicle; see `WaypointPaths` for what they are.

    Args:
        roads: The maps' lanes.
        table: The routes.
        m: Map number.
        place: The vehicle's x, y and the height of the road under it [m]; where they are not finite, there
            are no paths.
        lane: Lane within the map that the vehicle is on, -1 for none.
        route: Number of its route, -1 for none.
        hint: Distance gone along the route before [m], NaN if unknown; for routes that use a lane twice.
        mask: Bit k is set if lanes of kind k have paths.
        spacing: Between waypoints [m].
        paths: Written.

    Returns:
        The number of paths, and how many were left out, not counting where they would fork.
    """
    count, left_out = 0, 0
    if lane < 0 or not (abs(place[0]) < FARTHEST and abs(place[1]) < FARTHEST):
        return count, left_out
    base = roads.lane_base[m]
    own = row_of(table, m, route, base + lane, base, hint)
    group = _group_of(table, own)
    for row in range(group[0], group[1]):
        if mask >> roads.lane_kind[table.lane[row]] & 1:
            s = _start(roads, table, row, *place)
            if s >= 0.0:
                count, missing = _follow(roads, table, row, s, spacing, count, len(paths.length), paths)
                left_out += missing
    if left_out > 0:
        return _follow_own_lane_first(roads, table, group, own, place, mask, spacing, paths)
    return count, left_out
