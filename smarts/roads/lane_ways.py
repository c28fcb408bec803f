"""Kernels for places on lanes, and for the lanes that follow when a vehicle keeps its lane."""

from __future__ import annotations

import math

import numpy as np

from smarts.geometry.compiling import kernel
from smarts.geometry.segments import wrapped
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.kernels import find_row, nearest_segment
from smarts.roads.lane_graph import LaneKind

_REACH_ROWS = 48
_CAR = int(LaneKind.CAR)


@kernel
def place_on_lane(roads: Roads, lane: int, x: float, y: float, height: float) -> tuple[float, float]:
    """Return s and t [m] of a point on a lane; beyond the lane's ends, s is negative or above its length."""
    first, last = roads.point_start[lane], roads.point_start[lane + 1] - 2
    best, best_share, best_square, best_cross = nearest_segment(roads, first, last, x, y, height)
    a, b = roads.point_xy[best], roads.point_xy[best + 1]
    length = math.hypot(b[0] - a[0], b[1] - a[1])
    if (best_share < 0.0 and best == first) or (best_share > 1.0 and best == last):
        offset = best_cross / length
    else:
        offset = math.copysign(math.sqrt(best_square), best_cross)
        best_share = min(1.0, max(0.0, best_share))
    return float(roads.point_s[best] + best_share * (roads.point_s[best + 1] - roads.point_s[best])), offset


@kernel
def row_of(table: RouteTable, map_id: int, route: int, lane: int, first_lane: int, hint: float) -> int:
    """Return a lane's row in its route's corridor, or in the map's free corridor if it is off the route.

    Args:
        table: The routes.
        map_id: The map.
        route: The route, -1 for none.
        lane: The lane, numbered across all maps.
        first_lane: The map's first lane, numbered likewise.
        hint: Distance along the route near which the row is looked for [m].
    """
    row = find_row(table, table.free + route, lane, hint) if route >= 0 else -1
    return row if row >= 0 else table.start[map_id] + lane - first_lane


@kernel
def next_row(roads: Roads, table: RouteTable, map_id: int, row: int, first_lane: int) -> int:
    """Return the row after `row` for a vehicle that keeps its lane, or -1 where the road ends.

    On a route, it is the branch that stays longest on the route without a lane change, the first of equals.
    Off the route, or without one, it is the branch that turns least. A lane for cars leads into a bus lane
    only where it leads nowhere else.
    """
    first, last = table.onward_start[row], table.onward_start[row + 1]
    is_on_route = row >= table.start[table.free]
    if is_on_route and first == last:
        row = table.start[map_id] + table.lane[row] - first_lane
        first, last = table.onward_start[row], table.onward_start[row + 1]
        is_on_route = False
    if last - first < 2:
        return int(table.onward[first]) if last > first else -1
    best, best_value = -1, -np.inf
    is_for_cars = roads.lane_kind[table.lane[row]] == _CAR
    for entry in range(first, last):
        following = int(table.onward[entry])
        if is_for_cars and best >= 0:
            is_open = roads.lane_kind[table.lane[following]] == _CAR
            was_open = roads.lane_kind[table.lane[best]] == _CAR
            if was_open and not is_open:
                continue
            best_value = best_value if was_open == is_open else -np.inf
        value = _reach(table, following) if is_on_route else -_turn(roads, table.lane[following])
        if value > best_value + 1e-6:
            best, best_value = following, value
    return best


@kernel
def _reach(table: RouteTable, row: int) -> float:
    """Return the largest distance along the route that is reachable from a row without a lane change [m]."""
    stack = np.empty(_REACH_ROWS, np.int32)
    stack[0], count, visited, reach = row, 1, 0, -np.inf
    while count > 0 and visited < _REACH_ROWS:
        count -= 1
        row = int(stack[count])
        visited += 1
        reach = max(reach, table.end[row])
        for entry in range(table.onward_start[row], table.onward_start[row + 1]):
            if count < _REACH_ROWS:
                stack[count] = table.onward[entry]
                count += 1
    return reach


@kernel
def _turn(roads: Roads, lane: int) -> float:
    """Return the absolute change of heading from a lane's beginning to its end [rad]."""
    begin = roads.point_heading[roads.point_start[lane]]
    end = roads.point_heading[roads.point_start[lane + 1] - 1]
    return abs(wrapped(end - begin))
