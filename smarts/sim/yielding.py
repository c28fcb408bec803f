"""Yielding: whether an agent waits at a junction for crossing traffic; kernels for one vehicle."""

from __future__ import annotations

import numpy as np

from smarts.arrays import Floats, Ints
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.kernels import lane_length
from smarts.sim.places import corridor_row, lane_of
from smarts.types.traffic import Signal
from smarts.types.vehicles import STANDING
from smarts.types.world import State

NEAR_LINE = 8.0
"""A vehicle at a stop line has its front bumper at most this far before it [m]."""
STREAM_TIME = 3.0
"""A vehicle waits for others that reach its path within this time at their speed [s]."""

_MOST_WAYS = 32
_MOST_MEETINGS = 128
_MOST_LANES = 64
_STOP = int(Signal.STOP)


@kernel
def yields_to_stream(state: State, roads: Roads, routes: RouteTable, row: int, agent_id: int) -> bool:
    """Return whether moving traffic crosses the lanes ahead of an agent's standing vehicle.

    The vehicle is at a stop line or inside a junction, and a moving vehicle is, or gets within `STREAM_TIME`,
    to where its lane overlaps one of those ahead in this junction (`LaneGraph.conflict_lane`). All turns that
    the other vehicle may take count, except those with a red light. Right of way is ignored: two vehicles
    that wait for each other both stand, so neither blocks the other.
    """
    slot = state.agents.slot[row, agent_id]
    lane = lane_of(state, roads, state.vehicles, row, slot)
    if lane < 0:
        return False
    front = state.vehicles.lane_position[row, slot] + 0.5 * state.vehicles.length[row, slot]
    if not roads.lane_inside[lane] and lane_length(roads, lane) - front > NEAR_LINE:
        return False
    lanes = np.empty(_MOST_MEETINGS, np.int32)
    extents = np.empty((_MOST_MEETINGS, 2))
    count = _meetings_ahead(state, roads, routes, row, agent_id, lane, front, lanes, extents)
    if count == 0:
        return False
    for other in range(state.vehicles.alive.shape[1]):
        moves = state.vehicles.alive[row, other] and state.vehicles.speed[row, other] >= STANDING
        if (
            moves
            and other != slot
            and _comes(state, roads, routes, row, other, lanes[:count], extents[:count])
        ):
            return True
    return False


@kernel
def _meetings_ahead(
    state: State,
    roads: Roads,
    routes: RouteTable,
    row: int,
    agent_id: int,
    lane: int,
    front: float,
    lanes: Ints,
    extents: Floats,
) -> int:
    """List where others meet the way through the junction: their lanes, from and to [m]; return how many."""
    here = corridor_row(state, routes, row, agent_id, lane)
    if here < 0:
        here = _free_row(state, roads, routes, row, lane)
    ways = np.empty(_MOST_WAYS, np.int32)
    ways[0], left, count = here, 1, 0
    while left > 0:
        left -= 1
        here = int(ways[left])
        own = routes.lane[here]
        for entry in range(roads.conflict_start[own], roads.conflict_start[own + 1]):
            is_ahead = own != lane or roads.conflict_extent[entry, 0] >= front
            if is_ahead and count < len(lanes):
                lanes[count] = roads.conflict_lane[entry]
                extents[count, 0] = roads.conflict_other_extent[entry, 0]
                extents[count, 1] = roads.conflict_other_extent[entry, 1]
                count += 1
        for entry in range(routes.onward_start[here], routes.onward_start[here + 1]):
            if roads.lane_inside[routes.lane[routes.onward[entry]]] and left < len(ways):
                ways[left] = routes.onward[entry]
                left += 1
    return count


@kernel
def _free_row(state: State, roads: Roads, routes: RouteTable, row: int, lane: int) -> int:
    """Return the row of a lane on its map's corridor without a route."""
    world = state.map[row]
    return int(routes.start[world] + lane - roads.lane_base[world])


@kernel
def _comes(
    state: State, roads: Roads, routes: RouteTable, row: int, other: int, lanes: Ints, extents: Floats
) -> bool:
    """Return whether a moving vehicle is within one of some stretches of lanes, or reaches one soon."""
    lane = lane_of(state, roads, state.vehicles, row, other)
    if lane < 0:
        return False
    base = roads.lane_base[state.map[row]]
    half = 0.5 * state.vehicles.length[row, other]
    reach = half + STREAM_TIME * state.vehicles.speed[row, other]
    # Rows still to be looked at, and where on their lanes the vehicle's centre is: below 0 before they begin.
    rows, places = np.empty(_MOST_LANES, np.int32), np.empty(_MOST_LANES)
    rows[0], places[0] = _free_row(state, roads, routes, row, lane), state.vehicles.lane_position[row, other]
    left = 1
    while left > 0:
        left -= 1
        here, s = int(rows[left]), places[left]
        lane = routes.lane[here]
        for meeting in range(len(lanes)):
            begin, end = extents[meeting]
            if lanes[meeting] == lane and s + reach >= begin and s - half < end:
                return True
        s -= lane_length(roads, lane)
        if s + reach < 0.0:
            continue
        for entry in range(routes.onward_start[here], routes.onward_start[here + 1]):
            is_held_back = state.signals[row, routes.lane[routes.onward[entry]] - base] == _STOP
            if not is_held_back and left < len(rows):
                rows[left], places[left] = routes.onward[entry], s
                left += 1
    return False
