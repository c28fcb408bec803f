"""Kernels that find where a vehicle has to wait at junctions because others go first.

A meeting is a place where another lane inside a junction overlaps the own way (`LaneGraph.conflict_lane`).
Two vehicles must not be in it at the same time: by their footprints, their speeds and what they may do
next, each is there from a first to a last time. `precedence` decides which of them waits.
"""

from __future__ import annotations

import math

import numpy as np

from smarts.arrays import Floats, Ints
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.kernels import lane_length
from smarts.roads.lane_ways import place_on_lane, row_of
from smarts.roads.meetings import list_meetings
from smarts.roads.paces import Performance, acceleration_over
from smarts.roads.precedence import (
    BEGIN,
    CAP,
    END,
    GAIN,
    LINE,
    MARGINS,
    MEETING,
    OTHERS_BRAKING,
    SPEEDING_UP,
    can_stop,
    gap_to_stop,
    stop_before,
    waits,
)
from smarts.types.traffic import Signal
from smarts.types.vehicles import STANDING, Owner
from smarts.types.world import State

NEAR = 10.0
EASY_BRAKING = 2.0
"""Meetings are looked for from `NEAR` [m] before where a vehicle brakes this hard to its line on [m/s^2]."""
FORESIGHT = 8.0
"""Vehicles that come to a meeting later than this are left aside [s]."""
STUCK = 1.0
"""A vehicle behind a slower one, with which it cannot clear a meeting, does not enter it [m/s]."""
ROOM = 1.5
"""Gap to such a vehicle [m]."""
ASIDE = 1.2
"""A vehicle inside a junction is on all lanes whose middle is nearer than this [m]."""
ALONG = 0.8
"""Cosine of the angle to a lane, above which a vehicle may be on it."""

_MOST_MEETINGS, _MOST_LANES = 256, 48
_STOP, _CAUTION = int(Signal.STOP), int(Signal.CAUTION)
_AGENT = int(Owner.AGENT)


@kernel
def gap_to_wait(
    state: State,
    roads: Roads,
    routes: RouteTable,
    performance: Performance,
    b: int,
    slot: int,
    row: int,
    s: float,
    margins: float = 1.0,
) -> float:
    """Return the distance of the front bumper to where a vehicle has to wait for others [m], or infinity.

    That is the line of the junction, the waiting point of a turn inside it, or, past both, the meeting. The
    vehicle waits

    - for vehicles with the right of way that would be in a meeting within `precedence.MARGIN_AFTER` of it;
    - for vehicles that have to give way, but are past their line or can no longer stop there;
    - where the map does not say, for the one that comes first;
    - at a junction where all have to stop, until it has stopped at its line, and then for vehicles that
      have stopped at theirs before, or go;
    - where it could not leave a meeting, because a vehicle stands behind it on its way.

    A vehicle that stands at its line has the right of way over one that stands, too, only in its turn: the
    order of all that stand changes every `precedence.TURN_TIME`, so that one of them goes.

    Args:
        state: The state of the world.
        roads: The maps' lanes.
        routes: The agents' routes.
        performance: Performance of each kind of vehicle.
        b: The simulation.
        slot: The vehicle.
        row: The row in `routes` of the lane that it steers for.
        s: Its place on it [m].
        margins: Its driver's margins in time, in those of `precedence`: below 1 it takes smaller gaps.
    """
    vehicles, m = state.vehicles, state.map[b]
    half, speed = 0.5 * vehicles.length[b, slot], max(vehicles.speed[b, slot], 0.0)
    horizon = NEAR + 0.5 * speed * speed / EASY_BRAKING
    if not roads.lane_inside[routes.lane[row]] and lane_length(roads, routes.lane[row]) - s - half > horizon:
        return np.inf
    places = np.empty(_MOST_MEETINGS, np.int32)
    meetings = np.empty((_MOST_MEETINGS, MEETING))
    lanes, begins = np.empty(_MOST_LANES, np.int32), np.empty(_MOST_LANES)
    kind = vehicles.kind[b, slot]
    count, length = list_meetings(
        roads, routes, m, row, -s - half, half, performance, kind, horizon, places, meetings, lanes, begins
    )
    if count == 0:
        return np.inf
    places, meetings = places[:count], meetings[:count]
    meetings[:, MARGINS] = margins
    for i in range(count):
        top = max(meetings[i, CAP], 1.0)
        meetings[i, GAIN] = acceleration_over(performance, kind, meetings[i, END], speed, top)
    lanes, begins = lanes[:length], begins[:length]
    gap = min(
        gap_to_stop(state, roads, b, slot, lanes, begins),
        _gap_to_blocked(state, roads, b, slot, places, meetings, lanes, begins),
    )
    reach = horizon + 100.0
    x, y = vehicles.position[b, slot]
    for other in range(vehicles.alive.shape[1]):
        if other == slot or not vehicles.alive[b, other] or vehicles.lane[b, other] < 0:
            continue
        if abs(vehicles.position[b, other, 0] - x) > reach or abs(vehicles.position[b, other, 1] - y) > reach:
            continue
        gap = min(gap, _gap_for(state, roads, routes, b, slot, other, places, meetings))
    return gap


@kernel
def _gap_to_blocked(
    state: State, roads: Roads, b: int, slot: int, places: Ints, meetings: Floats, lanes: Ints, begins: Floats
) -> float:
    """Return the distance to where a vehicle waits because it could not leave a meeting [m], or infinity."""
    vehicles = state.vehicles
    base, length = roads.lane_base[state.map[b]], vehicles.length[b, slot]
    front = np.inf
    for other in range(vehicles.alive.shape[1]):
        if other == slot or not vehicles.alive[b, other] or vehicles.speed[b, other] > STUCK:
            continue
        for i in range(len(lanes)):
            if vehicles.lane[b, other] == lanes[i] - base and vehicles.lane[b, other] >= 0:
                place = begins[i] + vehicles.lane_position[b, other]
                if place > 0.0:
                    front = min(front, place - 0.5 * vehicles.length[b, other] - ROOM)
    gap = np.inf
    if front == np.inf:
        return gap
    for i in range(len(meetings)):
        begin, end = meetings[i, BEGIN], meetings[i, END] - length
        if begin < front and end > front - length and meetings[i, LINE] >= 0.0:
            gap = min(gap, stop_before(vehicles.speed[b, slot], meetings[i]))
    return gap


@kernel
def _gap_for(
    state: State,
    roads: Roads,
    routes: RouteTable,
    b: int,
    slot: int,
    other: int,
    places: Ints,
    meetings: Floats,
) -> float:
    """Return the distance to where a vehicle waits for another one [m], or infinity."""
    vehicles, m = state.vehicles, state.map[b]
    base, free = roads.lane_base[m], routes.start[m]
    here = base + vehicles.lane[b, other]
    place, half = vehicles.lane_position[b, other], 0.5 * vehicles.length[b, other]
    speed = max(vehicles.speed[b, other], 0.0)
    gap = np.inf
    if roads.lane_inside[here] or place < half:
        gap = _gap_inside(state, roads, routes, b, slot, other, places, meetings)
    # Lanes that it may come to, and where its centre is on them: below 0 before they begin.
    rows, centres = np.empty(_MOST_LANES, np.int32), np.empty(_MOST_LANES)
    rows[0], centres[0], left = _row_of(state, roads, routes, b, other, here), place, 1
    way_out = _signalled(state, roads, routes, b, other, int(rows[0]))
    reach = FORESIGHT * max(speed, STANDING) + 0.5 * SPEEDING_UP * FORESIGHT
    while left > 0:
        left -= 1
        row, centre = int(rows[left]), centres[left]
        lane = int(routes.lane[row])
        if centre <= 0.0 and roads.lane_inside[lane]:
            for i in range(len(places)):
                if roads.conflict_lane[places[i]] == lane and waits(
                    state, roads, b, slot, other, places[i], meetings[i], centre, -centre - half
                ):
                    gap = min(gap, stop_before(vehicles.speed[b, slot], meetings[i]))
        centre -= lane_length(roads, lane)
        if -centre - half > reach:
            continue
        if routes.onward_start[row] == routes.onward_start[row + 1]:
            # Where its lane leaves its route it may go anywhere.
            row = free + lane - base
        for entry in range(routes.onward_start[row], routes.onward_start[row + 1]):
            following, signalled = int(routes.onward[entry]), way_out if lane == here else -1
            if left < len(rows) and _may_take(
                state, roads, routes, b, lane, following, signalled, -centre - half, speed
            ):
                rows[left], centres[left] = following, centre
                left += 1
    return gap


@kernel
def _signalled(state: State, roads: Roads, routes: RouteTable, b: int, slot: int, row: int) -> int:
    """Return the edge that a vehicle signals to take next, -1 if its lane does not lead there.

    Edges are numbered across all maps.
    """
    following = state.vehicles.next_edge[b, slot]
    if following < 0:
        return -1
    edge = roads.edge_base[state.map[b]] + following
    for entry in range(routes.onward_start[row], routes.onward_start[row + 1]):
        if _exit_edge(roads, routes, int(routes.onward[entry])) == edge:
            return int(edge)
    return -1


@kernel
def _exit_edge(roads: Roads, routes: RouteTable, row: int) -> int:
    """Return the edge of a row's lane or, inside a junction, of the lane behind it; across all maps."""
    for _ in range(8):
        if not roads.lane_inside[routes.lane[row]]:
            break
        if routes.onward_start[row] == routes.onward_start[row + 1]:
            return -1
        row = int(routes.onward[routes.onward_start[row]])
    return int(roads.lane_edge[routes.lane[row]])


@kernel
def _row_of(state: State, roads: Roads, routes: RouteTable, b: int, slot: int, lane: int) -> int:
    """Return the row of a lane on the route of an agent's vehicle, of others in the map's free corridor."""
    agents, base = state.agents, roads.lane_base[state.map[b]]
    if state.vehicles.owner[b, slot] == _AGENT:
        for a in range(agents.slot.shape[1]):
            if agents.slot[b, a] == slot:
                hint = agents.route_progress[b, a]
                return row_of(routes, state.map[b], routes.number[b, a], lane, base, hint)
    return int(routes.start[state.map[b]] + lane - base)


@kernel
def _may_take(
    state: State,
    roads: Roads,
    routes: RouteTable,
    b: int,
    lane: int,
    following: int,
    signalled: int,
    room: float,
    speed: float,
) -> bool:
    """Return whether a vehicle may take a way behind its lane.

    Not if it signals another one, or is going to stop at the way's light.

    Args:
        state: The state of the world.
        roads: The maps' lanes.
        routes: The agents' routes.
        b: The simulation.
        lane: Its lane.
        following: The row of the first lane of the way.
        signalled: The edge that it signals, -1 if unknown.
        room: From its front bumper to the lane's end [m].
        speed: Speed of the vehicle [m/s].
    """
    if signalled >= 0 and _exit_edge(roads, routes, following) != signalled:
        return False
    after = int(routes.lane[following])
    if roads.lane_inside[lane] or not roads.lane_inside[after]:
        return True
    light = state.signals[b, after - roads.lane_base[state.map[b]]]
    return not (light in (_STOP, _CAUTION) and can_stop(speed, room, OTHERS_BRAKING))


@kernel
def _gap_inside(
    state: State,
    roads: Roads,
    routes: RouteTable,
    b: int,
    slot: int,
    other: int,
    places: Ints,
    meetings: Floats,
) -> float:
    """Return as `_gap_for`, for the lanes that a vehicle is on whose footprint is inside a junction.

    It is on every lane of its route that it drives along the middle of, where lanes diverge on each; without
    a route, of those that lead to the edge that it signals, or to the one that its centre is on.
    """
    vehicles = state.vehicles
    x, y = vehicles.position[b, other]
    half, gap = 0.5 * vehicles.length[b, other], np.inf
    base, free = roads.lane_base[state.map[b]], routes.start[state.map[b]]
    here = base + vehicles.lane[b, other]
    way_out = roads.lane_edge[here]
    if roads.lane_inside[here]:
        following = vehicles.next_edge[b, other]
        way_out = roads.edge_base[state.map[b]] + following if following >= 0 else -1
    is_on_route = _row_of(state, roads, routes, b, other, here) >= routes.start[routes.free]
    for i in range(len(places)):
        lane = int(roads.conflict_lane[places[i]])
        centre, aside = place_on_lane(roads, lane, x, y, vehicles.height[b, other])
        if centre <= 0.0 or centre > lane_length(roads, lane) + half:
            continue
        point = roads.point_start[lane] + int(
            (roads.point_start[lane + 1] - 1 - roads.point_start[lane])
            * min(centre / lane_length(roads, lane), 1.0)
        )
        is_along = math.cos(roads.point_heading[point] - vehicles.heading[b, other]) > ALONG
        if lane != here:
            if not is_along or abs(aside) > ASIDE or vehicles.speed[b, other] < STANDING:
                continue
            if is_on_route and _row_of(state, roads, routes, b, other, lane) < routes.start[routes.free]:
                continue
            if way_out >= 0 and _exit_edge(roads, routes, free + lane - base) != way_out:
                continue
        if waits(state, roads, b, slot, other, places[i], meetings[i], centre, -1.0):
            gap = min(gap, stop_before(vehicles.speed[b, slot], meetings[i]))
    return gap
