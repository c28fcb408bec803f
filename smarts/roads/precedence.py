"""Kernels that decide which of two vehicles goes first where their ways through a junction meet.

Both have a span of time in which they may be in the meeting. Where the spans overlap, the map says which
one waits (`Yields`), unless a vehicle cannot stop any more, or stands in the way.
"""

from __future__ import annotations

import math

import numpy as np

from smarts.arrays import Floats, Ints
from smarts.geometry.boxes import box_gaps
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads
from smarts.roads.kernels import lane_length, pose_on_lane
from smarts.roads.lane_graph import ConflictKind, Yields
from smarts.types.vehicles import STANDING
from smarts.types.world import State

BEGIN, END, OTHER_BEGIN, OTHER_END, LINE, CAP, WIDTH, LANE, MARGINS, GAIN, MEETING = range(11)
"""Columns of a meeting, and their number: from and to, until the tail is past, along the own way; along the
other lane; distance to the last point before it at which to wait, negative behind it [m]; highest speed
up to it [m/s]; width of the own lane there [m]; the own lane; the driver's margins, in those below; mean
acceleration until it is left [m/s^2]."""

MARGIN_AFTER = 1.0
"""Time from when the vehicle is out of a meeting until one with the right of way comes there [s]."""
MARGIN_BEFORE = 0.5
"""Time from when the other is out of a meeting until the vehicle comes there [s]."""
SHORT_MARGIN = 0.4
"""Both, towards vehicles that have to give way, and of a vehicle that is on its way through [s]."""
SPEEDING_UP = 2.0
"""Acceleration with which the vehicle comes to a meeting, at most [m/s^2]."""
OTHERS_SPEEDING_UP = 1.0
"""Acceleration of others but those that start: they let vehicles by that are in the junction [m/s^2]."""
SLACK = 0.2
"""Distance between a vehicle and the side of its lane that is left out of account [m]."""
HARD_BRAKING = 6.0
"""A vehicle that would have to brake harder to stop before a line drives on [m/s^2]..."""
OTHERS_BRAKING = 4.5
"""...and so do others [m/s^2]."""
MERGE_BRAKING = 2.5
"""How hard the one behind may have to brake where two lanes merge [m/s^2]."""
MERGE_GAP = 2.0
"""Gap to the vehicle ahead where two lanes merge [m]."""
CREEPING = 4.0
"""A slower vehicle at its line may take its turn [m/s]."""
NEAR_LINE = 8.0
"""A vehicle that stands farther from its line is in a queue [m]."""
AT_LINE = 4.0
"""Distance to their line within which vehicles stop where all have to stop [m]."""
NOSE = 1.0
"""A vehicle that stands nearer to a meeting is in the way [m]."""
TURN_TIME = 4.0
"""How long it is one vehicle's turn, of several that stand and wait for each other [s]."""
PATIENCE = 15.0
"""Where all have to stop, vehicles take turns, too, if the first one has not gone for so long [s]."""
ASIDE_GAP = 0.3
"""A vehicle that stands in a meeting is in the way if it is nearer to the vehicle that passes [m]."""
ALONG_STEP = 0.5
"""Distance between the places at which this is looked at [m]."""
CLEARANCE = 1.0
"""A vehicle that is past its line stops this far before a meeting [m]..."""
LEAST_GAP = 0.1
"""...which then is at least so far ahead [m]."""

_MERGE = int(ConflictKind.MERGE)
_THIS, _OTHER, _BOTH = int(Yields.THIS), int(Yields.OTHER), int(Yields.BOTH)


@kernel
def stop_before(speed: float, meeting: Floats) -> float:
    """Return the distance to where a vehicle stops before a meeting [m]."""
    line = meeting[LINE]
    if can_stop(speed, line, HARD_BRAKING):
        return line
    return max(meeting[BEGIN] - CLEARANCE, LEAST_GAP)


@kernel
def waits(
    state: State,
    roads: Roads,
    b: int,
    slot: int,
    other: int,
    place: int,
    meeting: Floats,
    centre: float,
    line: float,
) -> bool:
    """Return whether a vehicle waits for another one at a meeting.

    Args:
        state: The state of the world.
        roads: The maps' lanes.
        b: The simulation.
        slot: The vehicle.
        other: The other one.
        place: Row of the meeting in `Roads.conflict_lane`.
        meeting: Its columns, see `BEGIN`.
        centre: Where the other's centre is on its lane there [m].
        line: Distance of its front bumper to where it would wait, negative behind it [m].
    """
    vehicles = state.vehicles
    half, its_speed = 0.5 * vehicles.length[b, other], max(vehicles.speed[b, other], 0.0)
    speed, yields = max(vehicles.speed[b, slot], 0.0), roads.conflict_yields[place]
    is_merge = roads.conflict_kind[place] == _MERGE
    its_lane = roads.conflict_lane[place]
    # The lanes are wider than the vehicles on them; each extent is as long as the other lane is wide.
    own_room = max(0.5 * (roads.lane_width[its_lane] - vehicles.width[b, other]) - SLACK, 0.0)
    its_room = max(0.5 * (meeting[WIDTH] - vehicles.width[b, slot]) - SLACK, 0.0)
    begin, end = meeting[BEGIN] + own_room, meeting[END] - own_room
    to_begin = meeting[OTHER_BEGIN] - centre - half + its_room
    to_end = meeting[OTHER_END] - centre + half - its_room
    if is_merge:
        # The one behind only needs its distance: it follows the other where the lanes have become one.
        to_end = meeting[OTHER_BEGIN] - centre + half + MERGE_GAP
        end = begin + vehicles.length[b, slot] + MERGE_GAP
    if to_end <= 0.0:
        return False
    first = _soonest(begin, speed, SPEEDING_UP, np.inf)
    its_last = _soonest(to_end, its_speed, OTHERS_SPEEDING_UP if its_speed < CREEPING else 0.0, np.inf)
    stands = its_speed < STANDING
    if to_begin <= 0.0 and not stands:
        return first < its_last + meeting[MARGINS] * MARGIN_BEFORE
    if to_begin <= 0.0 and is_in_the_way(state, roads, b, slot, other, place, int(meeting[LANE])):
        return True
    is_past = not can_stop(speed, meeting[LINE], HARD_BRAKING)
    it_is_past = not can_stop(its_speed, line, OTHERS_BRAKING)
    starts = its_speed < CREEPING and line <= NEAR_LINE
    its_acceleration = SPEEDING_UP if starts else OTHERS_SPEEDING_UP
    its_first = _soonest(to_begin, its_speed, its_acceleration, max(roads.lane_speed[its_lane], its_speed))
    cap = max(meeting[CAP], 1.0)
    last = _soonest(end, min(speed, cap), meeting[GAIN], cap)
    before = after = SHORT_MARGIN
    if yields == _THIS and not is_past:
        before, after = MARGIN_BEFORE, MARGIN_AFTER
    before, after = meeting[MARGINS] * before, meeting[MARGINS] * after
    if is_merge:
        slower = max(its_speed - min(cap, speed + meeting[GAIN] * last), 0.0)
        after += 0.5 * slower * slower / MERGE_BRAKING / max(its_speed, 1.0)
    if its_first > last + after or its_last < first - before:
        return False
    if stands:
        return _waits_for_standing(state, b, slot, other, yields, meeting, to_begin, line, is_past)
    comes_first = its_first < first or (its_first == first and other < slot)
    if yields == _BOTH and not is_past and not it_is_past:
        # It stops at its line, too, unless it has stopped there and goes now.
        return has_stopped(state, b, other, line) and (speed < STANDING or comes_first)
    return _lets_by(yields, is_past, it_is_past, comes_first)


@kernel
def gap_to_stop(state: State, roads: Roads, b: int, slot: int, lanes: Ints, begins: Floats) -> float:
    """Return the distance to the line of a junction where all have to stop [m], or infinity.

    Args:
        state: The state of the world.
        roads: The maps' lanes.
        b: The simulation.
        slot: The vehicle.
        lanes: Lanes of its way.
        begins: Distance of its front bumper to their begins [m].
    """
    speed = state.vehicles.speed[b, slot]
    for i in range(1, len(lanes)):
        lane, line = lanes[i], begins[i]
        if roads.lane_inside[lanes[i - 1]] or not roads.lane_inside[lane]:
            continue
        if has_stopped(state, b, slot, line) or not can_stop(speed, line, HARD_BRAKING):
            continue
        for place in range(roads.conflict_start[lane], roads.conflict_start[lane + 1]):
            if roads.conflict_yields[place] == _BOTH:
                return line
    return np.inf


@kernel
def has_stopped(state: State, b: int, slot: int, line: float) -> bool:
    """Return whether a vehicle stands at its line, or starts from there.

    Args:
        state: The state of the world.
        b: The simulation.
        slot: The vehicle.
        line: Distance of its front bumper to its line [m].
    """
    speed, acceleration = state.vehicles.speed[b, slot], state.vehicles.acceleration[b, slot]
    return line <= AT_LINE and (speed < STANDING or (speed < CREEPING and acceleration > 0.0))


@kernel
def is_in_the_way(state: State, roads: Roads, b: int, slot: int, other: int, place: int, lane: int) -> bool:
    """Return whether a vehicle that passes a meeting in the middle of its lane would touch one that stands.

    Args:
        state: The state of the world.
        roads: The maps' lanes.
        b: The simulation.
        slot: The vehicle.
        other: The one that stands.
        place: Row of the meeting in `Roads.conflict_lane`.
        lane: The own lane there.
    """
    vehicles = state.vehicles
    half, half_width = 0.5 * vehicles.length[b, slot], 0.5 * vehicles.width[b, slot]
    there = (vehicles.position[b, other, 0], vehicles.position[b, other, 1], vehicles.heading[b, other])
    length, width = 0.5 * vehicles.length[b, other], 0.5 * vehicles.width[b, other]
    s = max(roads.conflict_extent[place, 0] - half, 0.0)
    last = min(roads.conflict_extent[place, 1] + half, lane_length(roads, lane))
    while s <= last:
        here = pose_on_lane(roads, lane, s)
        if max(box_gaps(here, half, half_width, there, length, width)) < ASIDE_GAP:
            return True
        s += ALONG_STEP
    return False


@kernel
def _lets_by(yields: int, is_past: bool, it_is_past: bool, comes_first: bool) -> bool:
    """Return whether a vehicle waits for one that moves and would be in a meeting at the same time."""
    if yields == _THIS:
        return True
    if yields == _OTHER and not it_is_past:
        return False
    return comes_first if is_past == it_is_past else it_is_past


@kernel
def _waits_for_standing(
    state: State,
    b: int,
    slot: int,
    other: int,
    yields: int,
    meeting: Floats,
    to_begin: float,
    line: float,
    is_past: bool,
) -> bool:
    """Return whether a vehicle waits for one that stands before a meeting, see `_waits`."""
    if line < 0.0 and to_begin < NOSE and state.vehicles.speed[b, slot] >= CREEPING:
        return True
    if line > NEAR_LINE or (line >= 0.0 and (is_past or yields == _OTHER)):
        return False
    speed = state.vehicles.speed[b, slot]
    if line < 0.0 and speed >= CREEPING:
        return yields == _THIS and not is_past
    if yields != _THIS and speed >= STANDING:
        return False
    is_waiting = speed < CREEPING and (is_past or meeting[LINE] <= NEAR_LINE)
    return not (is_waiting and _goes_before(state, b, slot, other, yields))


@kernel
def _goes_before(state: State, b: int, slot: int, other: int, yields: int) -> bool:
    """Return whether it is one vehicle's turn before that of another one, which stands.

    Where all have to stop, the first to stop goes first; elsewhere an order of all that changes with time.
    """
    if yields == _BOTH:
        since, its_since = state.vehicles.standing_since[b, slot], state.vehicles.standing_since[b, other]
        if since < 0:
            return True
        if (state.step[b] - max(since, its_since)) * state.dt < PATIENCE:
            return since < its_since or (since == its_since and slot < other)
    turn = 2 * int(state.step[b] * state.dt / TURN_TIME) + 1
    return (slot + 1) * turn * 40503 % 65536 < (other + 1) * turn * 40503 % 65536


@kernel
def can_stop(speed: float, room: float, braking: float) -> bool:
    """Return whether a vehicle stops within some room [m] if it brakes so hard [m/s^2]."""
    return room >= 0.0 and speed * speed <= 2.0 * braking * room + 0.01


@kernel
def _soonest(distance: float, speed: float, acceleration: float, top: float) -> float:
    """Return how long a vehicle takes for a distance that speeds up to a highest speed [s]."""
    distance = max(distance, 0.0)
    if acceleration <= 0.0 or speed >= top:
        return distance / max(min(speed, top), 1e-3)
    until_top = 0.5 * (top * top - speed * speed) / acceleration
    if distance > until_top:
        return (top - speed) / acceleration + (distance - until_top) / top
    return (math.sqrt(speed * speed + 2.0 * acceleration * distance) - speed) / acceleration
