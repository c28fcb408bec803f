"""Yielding: who stands at a junction because others cross its path. Compiled, for one vehicle."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from smarts.geometry.compiling import kernel
from smarts.roads.arrays import RouteTable
from smarts.roads.kernels import lane_length
from smarts.sim.judging import STANDING, State, corridor_row, lane_of
from smarts.types.traffic import Signal

NEAR_LINE = 8.0
"""Who stands at a stop line has its front bumper at most this far before it [m]."""
STREAM_TIME = 3.0
"""Who reaches one's path within this time, at the speed it has, is waited for [s]."""

_MOST_WAYS = 32
_MOST_MEETINGS = 128
_MOST_LANES = 64
_STOP = int(Signal.STOP)


@kernel
def yields_to_stream(state: State, table: RouteTable, row: int, agent_id: int) -> bool:
    """Tell whether the lanes on which an agent's standing vehicle is to go on are being crossed.

    It is at a stop line or inside a junction, and within `STREAM_TIME` a moving vehicle gets to where its
    lane overlaps one of those ahead in this junction (`LaneGraph.conflict_lane`), or is there. Where another
    will turn is not known: any of its ways counts, but for those that a red light closes. Nor is the right
    of way; but of two that wait for each other neither moves, so neither has a stream to wait for.
    """
    slot = state.agents.slot[row, agent_id]
    lane = lane_of(state, state.now, row, slot)
    if lane < 0:
        return False
    front = state.now.lane_position[row, slot] + 0.5 * state.now.length[row, slot]
    if not state.roads.lane_inside[lane] and lane_length(state.roads, lane) - front > NEAR_LINE:
        return False
    lanes = np.empty(_MOST_MEETINGS, np.int32)
    extents = np.empty((_MOST_MEETINGS, 2))
    count = _meetings_ahead(state, table, row, agent_id, lane, front, lanes, extents)
    if count == 0:
        return False
    for other in range(state.now.alive.shape[1]):
        moves = state.now.alive[row, other] and state.now.speed[row, other] >= STANDING
        if moves and other != slot and _comes(state, table, row, other, lanes[:count], extents[:count]):
            return True
    return False


@kernel
def _meetings_ahead(
    state: State,
    table: RouteTable,
    row: int,
    agent_id: int,
    lane: int,
    front: float,
    lanes: NDArray[np.int32],
    extents: NDArray[np.float64],
) -> int:
    """List where others meet the way through the junction: their lanes, from and to [m]; return how many."""
    here = corridor_row(state, table, row, agent_id, lane)
    if here < 0:
        here = _free_row(state, table, row, lane)
    ways = np.empty(_MOST_WAYS, np.int32)
    ways[0], left, count = here, 1, 0
    while left > 0:
        left -= 1
        here = int(ways[left])
        own = table.lane[here]
        facts = state.lanes
        for entry in range(facts.conflict_start[own], facts.conflict_start[own + 1]):
            is_ahead = own != lane or facts.conflict_extent[entry, 0] >= front
            if is_ahead and count < len(lanes):
                lanes[count] = facts.conflict_lane[entry]
                extents[count, 0] = facts.conflict_other_extent[entry, 0]
                extents[count, 1] = facts.conflict_other_extent[entry, 1]
                count += 1
        for entry in range(table.onward_start[here], table.onward_start[here + 1]):
            if state.roads.lane_inside[table.lane[table.onward[entry]]] and left < len(ways):
                ways[left] = table.onward[entry]
                left += 1
    return count


@kernel
def _free_row(state: State, table: RouteTable, row: int, lane: int) -> int:
    """Return the row of a lane on its map's corridor without a route."""
    world = state.map[row]
    return int(table.start[world] + lane - state.roads.lane_base[world])


@kernel
def _comes(
    state: State,
    table: RouteTable,
    row: int,
    other: int,
    lanes: NDArray[np.int32],
    extents: NDArray[np.float64],
) -> bool:
    """Tell whether a moving vehicle is within one of some stretches of lanes, or reaches one soon."""
    lane = lane_of(state, state.now, row, other)
    if lane < 0:
        return False
    base = state.roads.lane_base[state.map[row]]
    half = 0.5 * state.now.length[row, other]
    reach = half + STREAM_TIME * state.now.speed[row, other]
    # Rows still to be looked at, and where on their lanes the vehicle's centre is: below 0 before they begin.
    rows, places = np.empty(_MOST_LANES, np.int32), np.empty(_MOST_LANES)
    rows[0], places[0] = _free_row(state, table, row, lane), state.now.lane_position[row, other]
    left = 1
    while left > 0:
        left -= 1
        here, s = int(rows[left]), places[left]
        lane = table.lane[here]
        for meeting in range(len(lanes)):
            begin, end = extents[meeting]
            if lanes[meeting] == lane and s + reach >= begin and s - half < end:
                return True
        s -= lane_length(state.roads, lane)
        if s + reach < 0.0:
            continue
        for entry in range(table.onward_start[here], table.onward_start[here + 1]):
            is_held_back = state.signals[row, table.lane[table.onward[entry]] - base] == _STOP
            if not is_held_back and left < len(rows):
                rows[left], places[left] = table.onward[entry], s
                left += 1
    return False
