"""Kernels for the way ahead of a vehicle along its lanes: what is on it, and where it has to stop."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from smarts.arrays import Floats
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import segment_at, wrapped
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.kernels import centre_at, height_at, is_level, lane_length
from smarts.roads.lane_ways import next_row
from smarts.roads.lights import light_ahead
from smarts.types.traffic import Signal
from smarts.types.vehicles import VehicleStates
from smarts.types.world import State

SPACING = 2.0
"""Between the points of a way [m]."""
SIGHT = 76
"""Points of a way ahead: 150 m."""
BACK = 41
"""Points of a way behind: 80 m."""
SIDE_GAP = 0.2
"""A vehicle with more lateral clearance than this is not on the way [m]."""
SLOWING = 1.5
"""Deceleration to lower speed limits ahead [m/s^2]."""
TURNING_RADIUS = 1.4
"""Least radius at which the centre of a vehicle turns, in lengths of the vehicle."""
TILT = 0.13
"""By so much a vehicle is turned against its lane while it swings out [rad]."""
BEFORE_TURN = 4.0
"""A vehicle begins to swing out its length and this far before a turn [m]."""
MIRROR_TIME = 3.0
"""A vehicle does not swing out before one that comes from behind sooner [s]..."""
BESIDE = 5.0
"""...nearer than this to the side [m]."""
SAME_WAY = 0.5
"""Cosine of the angle between two headings, from which on vehicles drive the same way."""

_NONE, _STOP, _CAUTION = int(Signal.NONE), int(Signal.STOP), int(Signal.CAUTION)


class Way(NamedTuple):
    """What lies ahead along the lanes; distances are from the vehicle's centre [m]."""

    points: int
    """Points written."""
    left: float
    """To where the lane ends, or leaves the route; infinite if it does neither."""
    end: float
    """To where the lane ends and others of its road do not; infinite if it does not."""
    allowed: float
    """Speed at which the limits ahead can be kept [m/s]."""
    light: int
    """The first red or amber light, a `Signal`; NONE for none."""
    light_distance: float
    """To its line; infinite for none."""
    over: float
    """To where the road ends; infinite if that is out of sight."""


@kernel
def write_way(
    state: State, roads: Roads, routes: RouteTable, b: int, row: int, s: float, route: int, points: Floats
) -> Way:
    """Write x, y, heading, and height if asked, every 2 m along the lanes from arc length `s` of a lane on.

    Where the road ends, the points stop.

    Args:
        state: The state of the world.
        roads: The maps' lanes.
        routes: The agents' routes.
        b: The simulation.
        row: The first lane's row in `routes`.
        s: Where the way begins on it [m].
        route: The agent's route, -1 for none.
        points: Written, shape (P, 3), or (P, 4) with heights.
    """
    m = state.map[b]
    base, free = roads.lane_base[m], routes.start[m]
    lane = int(routes.lane[row])
    length, begin = lane_length(roads, lane), -s
    left, end, light, light_distance = np.inf, np.inf, _NONE, np.inf
    allowed = roads.lane_speed[lane]
    point, last = _segments(roads, lane, s)
    for i in range(len(points)):
        place = i * SPACING
        while place - begin > length:
            if light == _NONE and not roads.lane_inside[lane]:
                shown = light_ahead(routes, row, base, free, state.signals[b])
                if shown in (_STOP, _CAUTION):
                    light, light_distance = shown, begin + length
            if left == np.inf and _leaves_route(routes, row, route):
                left = begin + length
            if _ends(roads, routes, base, free, int(routes.lane[row])):
                left, end = min(left, begin + length), begin + length
            row = next_row(roads, routes, m, row, base)
            if row < 0:
                return Way(i, left, end, allowed, light, light_distance, begin + length)
            begin += length
            lane = int(routes.lane[row])
            length = lane_length(roads, lane)
            allowed = min(allowed, math.sqrt(roads.lane_speed[lane] ** 2 + 2.0 * SLOWING * max(begin, 0.0)))
            point, last = _segments(roads, lane, 0.0)
        while point < last and roads.point_s[point + 1] <= place - begin:
            point += 1
        points[i, 0], points[i, 1], points[i, 2] = centre_at(roads, point, place - begin)
        if points.shape[1] > 3:
            points[i, 3] = height_at(roads, point, place - begin)
    return Way(len(points), left, end, allowed, light, light_distance, np.inf)


@kernel
def _segments(roads: Roads, lane: int, s: float) -> tuple[int, int]:
    """Return the segment of a lane at an arc length, and its last one."""
    first, end = roads.point_start[lane], roads.point_start[lane + 1]
    return int(segment_at(roads.point_s, first, end, s)), int(end - 2)


@kernel
def _leaves_route(routes: RouteTable, row: int, route: int) -> bool:
    """Return whether a lane of the route leads off it at its end."""
    if route < 0 or row < routes.start[routes.free]:
        return False
    last = routes.start[routes.free + route + 1] - 1
    return (
        routes.onward_start[row + 1] == routes.onward_start[row] and routes.group[row] != routes.group[last]
    )


@kernel
def _ends(roads: Roads, routes: RouteTable, base: int, free: int, lane: int) -> bool:
    """Return whether nothing follows a lane, but something follows another lane of its road."""
    if _leads_on(routes, free, lane - base):
        return False
    left, right = int(roads.lane_left[lane]), int(roads.lane_right[lane])
    while left >= 0 or right >= 0:
        if left >= 0:
            if roads.lane_kind[left] == roads.lane_kind[lane] and _leads_on(routes, free, left - base):
                return True
            left = int(roads.lane_left[left])
        if right >= 0:
            if roads.lane_kind[right] == roads.lane_kind[lane] and _leads_on(routes, free, right - base):
                return True
            right = int(roads.lane_right[right])
    return False


@kernel
def _leads_on(routes: RouteTable, free: int, lane: int) -> bool:
    """Return whether any way leads on from a lane, numbered within its map."""
    return bool(routes.onward_start[free + lane + 1] > routes.onward_start[free + lane])


@kernel
def leader_on(vehicles: VehicleStates, b: int, slot: int, points: Floats) -> tuple[float, float]:
    """Return the gap to the first vehicle on a way, bumper to bumper [m], and its speed along it [m/s].

    The gap is infinite if there is none. Where the vehicle is going to swing out before a turn, vehicles in
    the lane beside are on its way, too; for one that comes from behind it waits before that.
    """
    nearest, speed = np.inf, 0.0
    if len(points) == 0:
        return nearest, speed
    reach = SPACING * len(points) + 10.0
    swing = _swing(points, vehicles.length[b, slot])
    for other in range(vehicles.alive.shape[1]):
        if other == slot or not vehicles.alive[b, other]:
            continue
        station, aside, turn = _place_on(vehicles, b, other, points, reach)
        along, across = _extents(vehicles, b, other, turn)
        is_outside = aside * swing.side > 0.0 and swing.begin - along < station < swing.end
        if station <= 0.0:
            comes = station + along + MIRROR_TIME * vehicles.speed[b, other] * math.cos(turn)
            if aside * swing.side > 0.0 and abs(aside) < BESIDE and 0.0 < swing.begin < min(comes, nearest):
                nearest, speed = swing.begin, 0.0
            continue
        room = SIDE_GAP + (swing.room if is_outside else 0.0)
        if abs(aside) - across - 0.5 * vehicles.width[b, slot] > room:
            continue
        gap = station - along - 0.5 * vehicles.length[b, slot]
        if gap < nearest:
            nearest, speed = gap, max(vehicles.speed[b, other] * math.cos(turn), 0.0)
    return nearest, speed


class Swing(NamedTuple):
    """Where a long vehicle swings out of its lane before a turn that is tighter than it turns."""

    begin: float
    """From the vehicle's centre, as `end` [m]."""
    end: float
    side: float
    """1 to the left, -1 to the right, 0: nowhere."""
    room: float
    """How far beyond its lane's path [m]."""


@kernel
def _swing(points: Floats, length: float) -> Swing:
    """Return where a vehicle swings out before the first tight turn of a way.

    Two straights and an arc of radius r that turns by phi are followed at radius R with an offset of at least
    (R - r) tan(phi / 4)^2; see docs/guide/control.md.
    """
    radius, turned, sharpest, begin, end = TURNING_RADIUS * length, 0.0, 0.0, -1, -1
    for i in range(len(points) - 2):
        bend = wrapped(points[i + 2, 2] - points[i, 2]) / (2.0 * SPACING)
        if abs(bend) * radius <= 1.0:
            if begin >= 0:
                break
            continue
        begin, end = i if begin < 0 else begin, i + 2
        turned += bend * SPACING
        sharpest = max(sharpest, abs(bend))
    if begin < 0:
        return Swing(0.0, 0.0, 0.0, 0.0)
    room = max(radius - 1.0 / sharpest, 0.0) * math.tan(0.25 * min(abs(turned), math.pi)) ** 2
    first = begin * SPACING - length - BEFORE_TURN
    return Swing(first, end * SPACING, -math.copysign(1.0, turned), room + 0.5 * TILT * length)


@kernel
def gap_behind(
    vehicles: VehicleStates, roads: Roads, b: int, slot: int, lane: int, s: float, heading: float
) -> tuple[float, float, float]:
    """Return gap [m], speed and desired speed [m/s] of the nearest vehicle behind a place in a lane.

    The lane is extended straight back beyond its begin. A vehicle beside has a negative gap.

    Args:
        vehicles: All vehicles.
        roads: The maps' lanes.
        b: The simulation.
        slot: The vehicle at the place, or that will be there.
        lane: The lane, numbered across all maps.
        s: The place on it [m].
        heading: Of the lane there [rad]; only vehicles that drive this way count.
    """
    points = np.empty((BACK, 4))
    _write_back(roads, lane, s, points)
    nearest, speed, desired = np.inf, 0.0, 0.0
    for other in range(vehicles.alive.shape[1]):
        if other == slot or not vehicles.alive[b, other]:
            continue
        if math.cos(vehicles.heading[b, other] - heading) < SAME_WAY:
            continue
        # Along the reversed way the vehicles behind are ahead.
        station, aside, turn = _place_on(vehicles, b, other, points, SPACING * BACK + 10.0)
        if station < 0.0:
            continue
        along, across = _extents(vehicles, b, other, turn)
        if abs(aside) - across - 0.5 * vehicles.width[b, slot] > SIDE_GAP:
            continue
        gap = station - along - 0.5 * vehicles.length[b, slot]
        if gap < nearest:
            nearest, speed = gap, vehicles.speed[b, other]
            desired = vehicles.desired_speed[b, other]
    return nearest, speed, desired


@kernel
def _write_back(roads: Roads, lane: int, s: float, points: Floats) -> None:
    """Write x, y, reversed heading and height every 2 m back along a lane from arc length `s`."""
    first, end = roads.point_start[lane], roads.point_start[lane + 1]
    for i in range(len(points)):
        place = s - i * SPACING
        # A segment's line goes on straight beyond its end, the first one's before the lane.
        point = segment_at(roads.point_s, first, end, place)
        x, y, heading = centre_at(roads, point, place)
        points[i, 0], points[i, 1], points[i, 2] = x, y, heading + math.pi
        points[i, 3] = height_at(roads, point, place)


@kernel
def _place_on(
    vehicles: VehicleStates, b: int, other: int, points: Floats, reach: float
) -> tuple[float, float, float]:
    """Return station and offset [m] of a vehicle on a way, and its relative heading.

    The station is -1 if the vehicle is far, or above or below the way.
    """
    x, y = vehicles.position[b, other, 0], vehicles.position[b, other, 1]
    if abs(x - points[0, 0]) > reach or abs(y - points[0, 1]) > reach:
        return -1.0, 0.0, 0.0
    best, best_square = 0, np.inf
    for i in range(len(points)):
        square = (points[i, 0] - x) ** 2 + (points[i, 1] - y) ** 2
        if square < best_square:
            best, best_square = i, square
    if not is_level(points[best, 3], vehicles.height[b, other]):
        return -1.0, 0.0, 0.0
    cos, sin = math.cos(points[best, 2]), math.sin(points[best, 2])
    dx, dy = x - points[best, 0], y - points[best, 1]
    station = best * SPACING + dx * cos + dy * sin
    if best == len(points) - 1 and dx * cos + dy * sin > SPACING:
        return -1.0, 0.0, 0.0
    return station, dy * cos - dx * sin, vehicles.heading[b, other] - points[best, 2]


@kernel
def _extents(vehicles: VehicleStates, b: int, slot: int, turn: float) -> tuple[float, float]:
    """Return half of a vehicle's extent along and across a way that it is turned against [m]."""
    cos, sin = abs(math.cos(turn)), abs(math.sin(turn))
    length, width = 0.5 * vehicles.length[b, slot], 0.5 * vehicles.width[b, slot]
    return cos * length + sin * width, sin * length + cos * width
