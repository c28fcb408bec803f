"""Waypoint paths: the lanes ahead as points at equal distances."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from smarts.arrays import Floats, Ints
from smarts.geometry.compiling import kernel
from smarts.geometry.frames import FARTHEST
from smarts.geometry.segments import segment_at
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.kernels import centre_at, find_row, lane_length, nearest_segment


class WaypointPaths(NamedTuple):
    """Paths of E vehicles: at most K paths each, of at most W waypoints. What is beyond a count is zero.

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

    path_count: Ints
    """Shape (E,)."""
    left_out: Ints
    """Paths that did not fit, not counting where they would fork, shape (E,)."""
    waypoint_count: Ints
    """Waypoints of each path, shape (E, K)."""
    position: Floats
    """[m], shape (E, K, W, 2)."""
    heading: Floats
    """[rad], shape (E, K, W)."""
    width: Floats
    """Of the lane [m], shape (E, K, W)."""
    speed_limit: Floats
    """[m/s], shape (E, K, W)."""
    lane: Ints
    """Lane within the map, shape (E, K, W)."""
    lane_index: Ints
    """Place of the lane across its road, 0 is the rightmost, shape (E, K, W)."""
    lane_offset: Floats
    """Arc length along the lane [m], shape (E, K, W)."""

    @classmethod
    def allocate(cls, vehicles: int, paths: int, lookahead: int) -> WaypointPaths:
        """Return empty buffers for E vehicles, K paths and W waypoints."""
        shape = (vehicles, paths, lookahead)
        return cls(
            path_count=np.zeros(vehicles, np.int32),
            left_out=np.zeros(vehicles, np.int32),
            waypoint_count=np.zeros((vehicles, paths), np.int32),
            position=np.zeros((*shape, 2)),
            heading=np.zeros(shape),
            width=np.zeros(shape),
            speed_limit=np.zeros(shape),
            lane=np.zeros(shape, np.int32),
            lane_index=np.zeros(shape, np.int32),
            lane_offset=np.zeros(shape),
        )


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
    base: int,
    e: int,
    first_path: int,
    limit: int,
    paths: WaypointPaths,
    forks: Ints,
    fork_s: Floats,
) -> tuple[int, int]:
    """Write the paths that begin at `s` of a row as far as they fit.

    Returns the number of paths after them, at most `limit`, and how many branches were left out.

    `forks` (rows, first waypoint, path that it copies) and `fork_s` are room for as many branches still to
    follow as a vehicle has paths. They are a stack that forgets its oldest branches where it is full: each
    branch followed is a path, so there is no room for what is forgotten.
    """
    lookahead = paths.heading.shape[2]
    forks[0, 0], forks[0, 1], forks[0, 2], fork_s[0] = row, 0, -1, s
    open_forks, path = 1, first_path
    while open_forks > 0 and path < limit:
        open_forks -= 1
        place = open_forks % len(forks)
        row, i, parent, s = forks[place, 0], forks[place, 1], forks[place, 2], fork_s[place]
        _copy_waypoints(paths, e, parent, path, i)
        while row >= 0:
            i, s = walk_lane(roads, table.lane[row], s, i, spacing, base, e, path, paths)
            if i == lookahead:
                break
            first, last = table.onward_start[row], table.onward_start[row + 1]
            for entry in range(last - 1, first, -1):
                place = open_forks % len(forks)
                forks[place, 0], forks[place, 1], forks[place, 2] = table.onward[entry], i, path
                fork_s[place] = s
                open_forks += 1
            row = int(table.onward[first]) if last > first else -1
        paths.waypoint_count[e, path] = i
        clear_waypoints(paths, e, path, i)
        path += 1
    return path, open_forks


@kernel
def _follow_own_lane_first(
    roads: Roads,
    table: RouteTable,
    group: tuple[int, int],
    own: int,
    x: float,
    y: float,
    height: float,
    mask: int,
    spacing: float,
    base: int,
    e: int,
    paths: WaypointPaths,
    forks: Ints,
    fork_s: Floats,
) -> tuple[int, int]:
    """Write the paths of a group of rows that has too many; see `WaypointPaths` for which are kept.

    Args:
        roads: The maps' lanes.
        table: The routes.
        group: The group's first row, and the one after its last.
        own: The row that the vehicle is on.
        x: Of the vehicle [m].
        y: Of the vehicle [m].
        height: Of the road under it [m].
        mask: Bit k is set if lanes of kind k have paths.
        spacing: Between waypoints [m].
        base: The map's first lane.
        e: The vehicle.
        paths: Written.
        forks: Room, see `_follow`.
        fork_s: Room, see `_follow`.

    Returns:
        The number of paths, and how many branches were left out.
    """
    first, last = group
    begin, away = np.full(last - first, -1.0), np.full(last - first, np.inf)
    kept = np.zeros(last - first, np.int32)
    for row in range(first, last):
        lane = table.lane[row]
        if mask >> roads.lane_kind[lane] & 1:
            begin[row - first] = s = _start(roads, table, row, x, y, height)
            if s >= 0.0:
                point = segment_at(roads.point_s, roads.point_start[lane], roads.point_start[lane + 1], s)
                at_x, at_y, _ = centre_at(roads, point, s)
                away[row - first] = -1.0 if row == own else math.hypot(at_x - x, at_y - y)
    room, left_out = paths.heading.shape[1], 0
    for place in np.argsort(away, kind="mergesort"):
        if begin[place] >= 0.0:
            kept[place], missing = _follow(
                roads, table, first + place, begin[place], spacing, base, e, 0, room, paths, forks, fork_s
            )
            room -= kept[place]
            left_out += missing
    count = 0
    for place in range(last - first):
        if kept[place] > 0:
            row, s, limit = first + place, begin[place], count + kept[place]
            count, _ = _follow(roads, table, row, s, spacing, base, e, count, limit, paths, forks, fork_s)
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
def clear_waypoints(paths: WaypointPaths, e: int, path: int, first: int) -> None:
    """Set the waypoints of a path to zero from number `first` on."""
    for i in range(first, paths.heading.shape[2]):
        paths.position[e, path, i, 0], paths.position[e, path, i, 1] = 0.0, 0.0
        paths.heading[e, path, i], paths.width[e, path, i], paths.speed_limit[e, path, i] = 0.0, 0.0, 0.0
        paths.lane[e, path, i], paths.lane_index[e, path, i], paths.lane_offset[e, path, i] = 0, 0, 0.0


@kernel
def _copy_waypoints(paths: WaypointPaths, e: int, source: int, target: int, count: int) -> None:
    for i in range(count):
        paths.position[e, target, i, 0] = paths.position[e, source, i, 0]
        paths.position[e, target, i, 1] = paths.position[e, source, i, 1]
        paths.heading[e, target, i] = paths.heading[e, source, i]
        paths.width[e, target, i] = paths.width[e, source, i]
        paths.speed_limit[e, target, i] = paths.speed_limit[e, source, i]
        paths.lane[e, target, i] = paths.lane[e, source, i]
        paths.lane_index[e, target, i] = paths.lane_index[e, source, i]
        paths.lane_offset[e, target, i] = paths.lane_offset[e, source, i]


@kernel
def walk_lane(
    roads: Roads,
    lane: int,
    s: float,
    i: int,
    spacing: float,
    base: int,
    e: int,
    path: int,
    paths: WaypointPaths,
) -> tuple[int, float]:
    """Write waypoints from `s` to the lane's end; return the next one's number and its overhang [m]."""
    point, last_point = roads.point_start[lane], roads.point_start[lane + 1] - 2
    length = lane_length(roads, lane)
    lookahead = paths.heading.shape[2]
    while i < lookahead and s <= length:
        while point < last_point and roads.point_s[point + 1] <= s:
            point += 1
        write_waypoint(roads, base, lane, s, centre_at(roads, point, s), e, path, i, paths)
        i += 1
        s += spacing
    return i, s - length


@kernel
def write_waypoint(
    roads: Roads,
    base: int,
    lane: int,
    s: float,
    pose: tuple[float, float, float],
    e: int,
    path: int,
    i: int,
    paths: WaypointPaths,
) -> None:
    """Write waypoint `i` of a path, at a pose: x, y [m], heading [rad]; `base` is the map's first lane."""
    paths.position[e, path, i, 0], paths.position[e, path, i, 1], paths.heading[e, path, i] = pose
    paths.width[e, path, i] = roads.lane_width[lane]
    paths.speed_limit[e, path, i] = roads.lane_speed[lane]
    paths.lane[e, path, i] = lane - base
    paths.lane_index[e, path, i] = roads.lane_index[lane]
    paths.lane_offset[e, path, i] = s


@kernel
def write_waypoints(
    roads: Roads,
    table: RouteTable,
    maps: Ints,
    position: Floats,
    height: Floats,
    lane: Ints,
    route: Ints,
    hint: Floats,
    mask: int,
    spacing: float,
    paths: WaypointPaths,
) -> None:
    """Write the waypoint paths of each vehicle; see `WaypointPaths` for what they are.

    Args:
        roads: The maps' lanes.
        table: The routes.
        maps: Map of each vehicle, shape (E,).
        position: [m], shape (E, 2); where it is not finite, there are no paths.
        height: Of the road under it [m], shape (E,).
        lane: Lane within its map that the vehicle is on, -1 for none, shape (E,).
        route: Number of its route, -1 for none, shape (E,).
        hint: Distance gone along the route before [m], NaN if unknown; for routes that use a lane twice.
        mask: Bit k is set if lanes of kind k have paths.
        spacing: Between waypoints [m].
        paths: Written.
    """
    most = paths.heading.shape[1]
    most_forks = max(1, most)
    forks = np.empty((most_forks, 3), np.int32)
    fork_s = np.empty(most_forks)
    for e in range(len(maps)):
        count, left_out = 0, 0
        x, y = position[e, 0], position[e, 1]
        if lane[e] >= 0 and abs(x) < FARTHEST and abs(y) < FARTHEST:
            base = roads.lane_base[maps[e]]
            row = -1
            if route[e] >= 0:
                row = find_row(table, table.free + route[e], base + lane[e], hint[e])
            if row < 0:
                row = table.start[maps[e]] + lane[e]
            group = _group_of(table, row)
            for each in range(group[0], group[1]):
                s = -1.0
                if mask >> roads.lane_kind[table.lane[each]] & 1:
                    s = _start(roads, table, each, x, y, height[e])
                if s >= 0.0:
                    count, missing = _follow(
                        roads, table, each, s, spacing, base, e, count, most, paths, forks, fork_s
                    )
                    left_out += missing
            if left_out > 0:
                count, left_out = _follow_own_lane_first(
                    roads, table, group, row, x, y, height[e], mask, spacing, base, e, paths, forks, fork_s
                )
        paths.path_count[e], paths.left_out[e] = count, left_out
        for path in range(count, paths.heading.shape[1]):
            paths.waypoint_count[e, path] = 0
            clear_waypoints(paths, e, path, 0)
