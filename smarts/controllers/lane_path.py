"""Kernels for the lanes that a vehicle follows, and its reference along them."""

from __future__ import annotations

import math

import numpy as np

from smarts.arrays import Floats
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import project, segment_at, wrapped
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.kernels import centre_at, find_row, lane_length

NEAR_SPACING = 1.0
"""Spacing of the first `NEAR_POINTS` points of a reference [m]; it then grows by `GROWTH` per point."""
NEAR_POINTS = 32
GROWTH = 1.06

LATERAL_SPEED = 1.3
"""Maximum lateral speed towards the centreline [m/s]."""
LATERAL_TIME = 0.9
"""Time constant of the approach to the centreline [s]."""
STEEPEST = 0.25
"""Maximum slope of a reference against the centreline."""
TRACKED_OFFSET = 0.3
"""The tracking law corrects offsets up to this; for larger ones, references approach the centreline [m]."""

CURVE_ACCELERATION = 3.0
"""Maximum lateral acceleration in curves [m/s^2]."""
BRAKING = 2.0
"""Deceleration before slower points ahead [m/s^2]."""
AGILITY_SHARE = 0.95
"""Share of the steering rate that curves may use; the rest is for feedback."""
LEAST_CURVE_SPEED = 2.0
"""Lower bound of speed limits by curves [m/s]."""
_REACH_ROWS = 48


@kernel
def place_on_lane(roads: Roads, lane: int, x: float, y: float) -> tuple[float, float]:
    """Return s and t [m] of a point on a lane; beyond the lane's ends, s is negative or above its length."""
    first, last = roads.point_start[lane], roads.point_start[lane + 1] - 2
    best, best_square, best_share, best_cross = first, np.inf, 0.0, 0.0
    for point in range(first, last + 1):
        a, b = roads.point_xy[point], roads.point_xy[point + 1]
        share, square, cross = project(x, y, a[0], a[1], b[0], b[1])
        if square < best_square:
            best, best_square, best_share, best_cross = point, square, share, cross
    a, b = roads.point_xy[best], roads.point_xy[best + 1]
    length = math.hypot(b[0] - a[0], b[1] - a[1])
    if (best_share < 0.0 and best == first) or (best_share > 1.0 and best == last):
        offset = best_cross / length
    else:
        offset = math.copysign(math.sqrt(best_square), best_cross)
        best_share = min(1.0, max(0.0, best_share))
    return roads.point_s[best] + best_share * (roads.point_s[best + 1] - roads.point_s[best]), offset


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
    Off the route, or without one, it is the branch that turns least.
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
    for entry in range(first, last):
        following = int(table.onward[entry])
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


@kernel
def write_reference(
    roads: Roads,
    table: RouteTable,
    map_id: int,
    row: int,
    s: float,
    t: float,
    speed: float,
    cap: float,
    obey_limit: bool,
    agility: float,
    reference: Floats,
) -> None:
    """Write a vehicle's reference along its lane and the lanes after it.

    Args:
        roads: The maps' lanes.
        table: The routes.
        map_id: The map.
        row: The lane's row in `table`.
        s: Arc length of the vehicle on the lane [m].
        t: Offset of the vehicle to the left of the lane [m].
        speed: Speed of the vehicle [m/s].
        cap: Maximum speed [m/s].
        obey_limit: Whether the lanes' speed limits apply too.
        agility: Maximum rate of change of the vehicle's curvature [1/(m s)].
        reference: The reference, written, shape (R, 4), see `Commands`.
    """
    count = len(reference)
    first_lane = roads.lane_base[map_id]
    lane = table.lane[row]
    length = lane_length(roads, lane)
    offset = math.copysign(max(abs(t) - TRACKED_OFFSET, 0.0), t)
    spacing = NEAR_SPACING
    is_over = False
    point = segment_at(roads.point_s, roads.point_start[lane], roads.point_start[lane + 1], s)
    last = roads.point_start[lane + 1] - 2
    for i in range(count):
        while s > length and not is_over:
            following = next_row(roads, table, map_id, row, first_lane)
            if following < 0:
                is_over = True
            else:
                row = following
                s -= length
                lane = table.lane[row]
                length = lane_length(roads, lane)
                point, last = int(roads.point_start[lane]), roads.point_start[lane + 1] - 2
        while point < last and roads.point_s[point + 1] <= s:
            point += 1
        x, y, heading = centre_at(roads, point, s)
        slope = 0.0
        if offset != 0.0:
            slope = min(STEEPEST, min(LATERAL_SPEED, abs(offset) / LATERAL_TIME) / max(speed, 4.0))
            slope = -math.copysign(slope, offset)
            x, y = x - offset * math.sin(heading), y + offset * math.cos(heading)
            heading = wrapped(heading + math.atan(slope))
        reference[i, 0], reference[i, 1], reference[i, 2] = x, y, heading
        reference[i, 3] = min(cap, roads.lane_speed[lane]) if obey_limit else cap
        offset += slope * spacing
        s += spacing
        if i >= NEAR_POINTS:
            spacing *= GROWTH
    limit_speeds(reference, count, agility)


@kernel
def limit_speeds(reference: Floats, count: int, agility: float) -> None:
    """Lower a reference's speeds to the limits of its curves, and to braking in time for these.

    Args:
        reference: The reference, shape (R, 4), see `Commands`.
        count: Number of points of the reference.
        agility: Maximum rate of change of the vehicle's curvature [1/(m s)].
    """
    curvature = np.empty(count)
    for i in range(count):
        before, after = max(i - 2, 0), min(i + 2, count - 1)
        curvature[i] = wrapped(reference[after, 2] - reference[before, 2]) / _span(reference, before, after)
    for i in range(count):
        fastest = math.sqrt(CURVE_ACCELERATION / max(abs(curvature[i]), 1e-4))
        before, after = max(i - 3, 0), min(i + 3, count - 1)
        change = abs(curvature[after] - curvature[before]) / _span(reference, before, after)
        fastest = min(fastest, AGILITY_SHARE * agility / max(change, 1e-6))
        reference[i, 3] = min(reference[i, 3], max(fastest, LEAST_CURVE_SPEED))
    for i in range(count - 2, -1, -1):
        a, b = reference[i], reference[i + 1]
        room = math.hypot(b[0] - a[0], b[1] - a[1])
        reference[i, 3] = min(a[3], math.sqrt(b[3] * b[3] + 2.0 * BRAKING * room))


@kernel
def _span(reference: Floats, before: int, after: int) -> float:
    """Return the distance between two points of a reference, at least 2 m."""
    a, b = reference[before], reference[after]
    return max(math.hypot(b[0] - a[0], b[1] - a[1]), 2.0)
