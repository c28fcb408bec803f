"""Kernels that find where a vehicle has to wait at a junction because others go first."""

from __future__ import annotations

import math

import numpy as np

from smarts.arrays import Floats, Ints
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import wrapped
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.kernels import lane_length
from smarts.roads.lane_ways import next_row
from smarts.types.traffic import Signal
from smarts.types.vehicles import Owner
from smarts.types.world import State

LOOK_AHEAD = 60.0
"""Distance to the line from which on others are looked for [m]."""
MARGIN = 1.0
"""Time between two vehicles at a place where their lanes overlap [s]."""
PRIORITY_MARGIN = 3.0
"""The same before a vehicle that goes straight, to one that turns, and slows down for the curve [s]."""
OPPOSITE = -0.7
"""Cosine of the angle between two headings, up to which they are opposite."""
STANDING = 0.5
"""A slower vehicle stands [m/s]."""
WAITING_ROOM = 1.0
"""A vehicle that stands inside the junction farther before the meeting waits itself [m]."""
NEAR_LINE = 6.0
"""A vehicle farther from its line does not wait there [m]."""
STARTED = 1.0
"""A faster vehicle has started [m/s]."""
TURN_TIME = 4.0
"""How long it is one agent's turn, of two that stand at their lines [s]."""
CLEARANCE = 1.0
"""Inside a junction a vehicle waits this far before the others' way [m]..."""
LEAST_GAP = 0.1
"""...which then is at least so far ahead [m]."""
STARTING = 2.0
"""Acceleration with which a vehicle crosses [m/s^2]."""
STRAIGHT = 0.3
"""Largest turn of a lane that goes straight on [rad]."""

_MOST_MEETINGS = 128
_NONE, _STOP, _GO = int(Signal.NONE), int(Signal.STOP), int(Signal.GO)
_AGENT = int(Owner.AGENT)


@kernel
def gap_to_junction(
    state: State, roads: Roads, routes: RouteTable, b: int, slot: int, row: int, s: float
) -> float:
    """Return the distance of the front bumper to where a vehicle has to wait [m], or infinity.

    Another vehicle goes first if it is, or at its speed would be, where its lane overlaps the own way less
    than `MARGIN` before or after the own vehicle. With two green lights, or from opposite directions without
    lights, the one that goes straight goes first. Of two agents the one that comes first does; two that stand
    take turns. Inside the junction a vehicle waits before the place where it would meet the other.

    Args:
        state: The state of the world.
        roads: The maps' lanes.
        routes: The agents' routes.
        b: The simulation.
        slot: The vehicle.
        row: The row in `routes` of the lane that it steers for.
        s: Its place on it [m].
    """
    vehicles, m = state.vehicles, state.map[b]
    base, half = roads.lane_base[m], 0.5 * vehicles.length[b, slot]
    is_inside = roads.lane_inside[routes.lane[row]]
    to_line = lane_length(roads, routes.lane[row]) - s - half
    if not is_inside and not 0.0 <= to_line < LOOK_AHEAD:
        return np.inf
    begin = -s - half
    if not is_inside:
        row, begin = next_row(roads, routes, m, row, base), to_line
    if row < 0 or not roads.lane_inside[routes.lane[row]]:
        return np.inf
    entry = int(routes.lane[row])
    lanes, extents = np.empty(_MOST_MEETINGS, np.int32), np.empty((_MOST_MEETINGS, 5))
    count = _list_meetings(roads, routes, m, row, begin, half, is_inside, lanes, extents)
    if not is_inside:
        waits = _any_goes_first(state, roads, routes, b, slot, entry, lanes[:count], extents[:count])
        return to_line if waits else np.inf
    nearest = np.inf
    for i in range(count):
        gap = max(extents[i, 0] - CLEARANCE, LEAST_GAP)
        if extents[i, 0] > 0.0 and gap < nearest:
            one, its = lanes[i : i + 1], extents[i : i + 1]
            if _any_goes_first(state, roads, routes, b, slot, entry, one, its):
                nearest = gap
    return nearest


@kernel
def _list_meetings(
    roads: Roads,
    routes: RouteTable,
    m: int,
    row: int,
    begin: float,
    half: float,
    is_inside: bool,
    lanes: Ints,
    extents: Floats,
) -> int:
    """List where others' lanes meet the way through a junction; return how many.

    Args:
        roads: The maps' lanes.
        routes: The agents' routes.
        m: The map.
        row: The first row inside the junction.
        begin: From the front bumper to its begin [m]; negative behind.
        half: Half of the vehicle's length [m].
        is_inside: Whether the vehicle is inside the junction.
        lanes: The others' lanes, written.
        extents: Written: from and to along the own way, until the tail is past; from and to along the other
            lane [m]; 1 if the vehicle is inside.
    """
    count, base = 0, roads.lane_base[m]
    while row >= 0 and roads.lane_inside[routes.lane[row]]:
        own = int(routes.lane[row])
        for place in range(roads.conflict_start[own], roads.conflict_start[own + 1]):
            if count < len(lanes):
                lanes[count] = roads.conflict_lane[place]
                extents[count, 0] = begin + roads.conflict_extent[place, 0]
                extents[count, 1] = begin + roads.conflict_extent[place, 1] + 2.0 * half
                extents[count, 2] = roads.conflict_other_extent[place, 0]
                extents[count, 3] = roads.conflict_other_extent[place, 1]
                extents[count, 4] = 1.0 if is_inside else 0.0
                count += 1
        begin += lane_length(roads, own)
        row = next_row(roads, routes, m, row, base)
    return count


@kernel
def _any_goes_first(
    state: State,
    roads: Roads,
    routes: RouteTable,
    b: int,
    slot: int,
    entry: int,
    lanes: Ints,
    extents: Floats,
) -> bool:
    """Return whether any vehicle is to be let by."""
    vehicles = state.vehicles
    for other in range(vehicles.alive.shape[1]):
        if other == slot or not vehicles.alive[b, other] or vehicles.lane[b, other] < 0:
            continue
        if _goes_first(state, roads, routes, b, slot, other, entry, lanes, extents):
            return True
    return False


@kernel
def _goes_first(
    state: State,
    roads: Roads,
    routes: RouteTable,
    b: int,
    slot: int,
    other: int,
    entry: int,
    lanes: Ints,
    extents: Floats,
) -> bool:
    """Return whether another vehicle, wherever it may turn, is to be let by."""
    vehicles, m = state.vehicles, state.map[b]
    base, free = roads.lane_base[m], routes.start[m]
    lane = base + vehicles.lane[b, other]
    place = vehicles.lane_position[b, other]
    if roads.lane_inside[lane]:
        goes_first = _has_priority(state, roads, b, lane, entry)
        if _meets(state, b, slot, other, lane, place, lanes, extents, True, goes_first):
            return True
    elif not _comes(state, roads, b, slot, other, lane_length(roads, lane) - place):
        return False
    here = free + lane - base
    for first in range(routes.onward_start[here], routes.onward_start[here + 1]):
        following = int(routes.onward[first])
        way = int(routes.lane[following])
        if not roads.lane_inside[way] or state.signals[b, way - base] == _STOP:
            continue
        if not roads.lane_inside[lane] and _has_priority(state, roads, b, entry, way):
            continue
        before = place - lane_length(roads, lane)
        goes_first = _has_priority(state, roads, b, way, entry)
        if _meets(state, b, slot, other, way, before, lanes, extents, roads.lane_inside[lane], goes_first):
            return True
        for second in range(routes.onward_start[following], routes.onward_start[following + 1]):
            last = int(routes.lane[routes.onward[second]])
            further = before - lane_length(roads, way)
            if roads.lane_inside[last] and _meets(
                state, b, slot, other, last, further, lanes, extents, roads.lane_inside[lane], False
            ):
                return True
    return False


@kernel
def _comes(state: State, roads: Roads, b: int, slot: int, other: int, left: float) -> bool:
    """Return whether a vehicle before a junction, with so much of its lane left [m], may go first."""
    vehicles = state.vehicles
    if vehicles.speed[b, other] >= STANDING:
        return left <= 2.0 * LOOK_AHEAD
    if _is_inside(state, roads, b, slot):
        return False
    return left - 0.5 * vehicles.length[b, other] <= NEAR_LINE and _lets_by(state, b, slot, other)


@kernel
def _is_inside(state: State, roads: Roads, b: int, slot: int) -> bool:
    """Return whether a vehicle is inside a junction."""
    lane = state.vehicles.lane[b, slot]
    return lane >= 0 and bool(roads.lane_inside[roads.lane_base[state.map[b]] + lane])


@kernel
def _lets_by(state: State, b: int, slot: int, other: int) -> bool:
    """Return whether of two agents that stand at their lines the other one goes first.

    They take turns, so that one that does not start holds back no other for long.
    """
    vehicles = state.vehicles
    if vehicles.owner[b, other] != _AGENT or vehicles.speed[b, slot] >= STARTED:
        return False
    turn = int(state.step[b] * state.dt / TURN_TIME) + slot + other
    return (other < slot) == (turn % 2 == 0)


@kernel
def _has_priority(state: State, roads: Roads, b: int, own: int, other: int) -> bool:
    """Return whether the own lane goes straight and the other turns, with equal rights otherwise.

    That is with two green lights, or without lights from the opposite direction.
    """
    base = roads.lane_base[state.map[b]]
    if _turn(roads, own) >= STRAIGHT or _turn(roads, other) < STRAIGHT:
        return False
    light, its_light = state.signals[b, own - base], state.signals[b, other - base]
    if light == _GO and its_light == _GO:
        return True
    heading = roads.point_heading[roads.point_start[own]]
    its_heading = roads.point_heading[roads.point_start[other]]
    return light == _NONE and its_light == _NONE and math.cos(heading - its_heading) < OPPOSITE


@kernel
def _turn(roads: Roads, lane: int) -> float:
    begin = roads.point_heading[roads.point_start[lane]]
    return abs(wrapped(roads.point_heading[roads.point_start[lane + 1] - 1] - begin))


@kernel
def _meets(
    state: State,
    b: int,
    slot: int,
    other: int,
    lane: int,
    place: float,
    lanes: Ints,
    extents: Floats,
    is_inside: bool,
    goes_first: bool,
) -> bool:
    """Return whether another vehicle on, or before, a lane comes to the own way at about the same time."""
    vehicles = state.vehicles
    margin = PRIORITY_MARGIN if goes_first else MARGIN
    half, speed = 0.5 * vehicles.length[b, other], vehicles.speed[b, other]
    for i in range(len(lanes)):
        if lanes[i] != lane or place - half > extents[i, 3]:
            continue
        own_first = _time_to(extents[i, 0], vehicles.speed[b, slot])
        own_last = _time_to(extents[i, 1], vehicles.speed[b, slot])
        to_meeting = extents[i, 2] - place - half
        if to_meeting <= 0.0:
            return True
        if speed < STANDING:
            # A vehicle inside waits, unless it is in the way; one before its line was let by.
            if not is_inside or to_meeting < WAITING_ROOM:
                return True
            continue
        is_agent = vehicles.owner[b, other] == _AGENT
        beyond = extents[i, 3] - place + half
        # Agents are expected to drive on as the own vehicle does, others to keep their speeds.
        first = _time_to(to_meeting, speed) if is_agent else to_meeting / speed
        last = _time_to(beyond, speed) if is_agent else beyond / speed
        if first > own_last + margin or last < own_first - MARGIN:
            continue
        if goes_first or not is_agent or (is_inside and extents[i, 4] == 0.0):
            return True
        if first < own_first or (first == own_first and other < slot):
            return True
    return False


@kernel
def _time_to(distance: float, speed: float) -> float:
    """Return how long a vehicle takes for a distance if it speeds up [s]."""
    return (math.sqrt(speed * speed + 2.0 * STARTING * max(distance, 0.0)) - speed) / STARTING
