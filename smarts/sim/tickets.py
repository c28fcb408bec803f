"""Tickets: the order in which agents arrive at a junction."""

from __future__ import annotations

import numpy as np

from smarts.geometry.compiling import kernel
from smarts.roads.arrays import RouteTable
from smarts.sim.judging import State, corridor_row, lane_of
from smarts.types.seats import SeatState

NEAR = 40.0
"""An agent arrives when it is this far from a junction [m]."""

_ACTIVE = int(SeatState.ACTIVE)
_DONE = int(SeatState.DONE)


@kernel
def issue_tickets(state: State, table: RouteTable, row: int) -> None:
    """Let agents draw tickets for the next junction on their routes; write the seats' tickets.

    An agent draws one when it comes near, keeps it until it is through, and has none on the way to a junction
    far off. Among those who hold one for the same junction, a lower number came earlier; of agents who come
    in the same step, the nearer, then the one in the lower seat. Who is done keeps it for this one step.
    """
    seats = state.seats
    count = seats.slot.shape[1]
    distance = np.full(count, np.inf)
    for seat in range(count):
        if seats.state[row, seat] == _DONE:
            continue
        junction, ahead = -1, np.inf
        if seats.state[row, seat] == _ACTIVE and seats.slot[row, seat] >= 0:
            junction, ahead = _next_junction(state, table, row, seat)
            if ahead > NEAR:
                junction = -1
        if junction != seats.ticket_junction[row, seat]:
            seats.ticket[row, seat], seats.ticket_junction[row, seat] = -1, junction
            if junction >= 0:
                distance[seat] = ahead
    for _ in range(count):
        seat = int(np.argmin(distance))
        if distance[seat] == np.inf:
            break
        seats.ticket[row, seat] = _next_number(state, row, seats.ticket_junction[row, seat])
        distance[seat] = np.inf


@kernel
def _next_number(state: State, row: int, junction: int) -> int:
    """Return the number after those of all who hold a ticket for a junction."""
    highest = -1
    for seat in range(state.seats.ticket.shape[1]):
        if state.seats.ticket_junction[row, seat] == junction:
            highest = max(highest, state.seats.ticket[row, seat])
    return highest + 1


@kernel
def _next_junction(state: State, table: RouteTable, row: int, seat: int) -> tuple[int, float]:
    """Return the junction that the agent is in, else the next on its route, and how far it is [m].

    Off its route, the agent goes on to the junction that it has a ticket for.
    """
    lane = lane_of(state, state.now, row, state.seats.slot[row, seat])
    here = corridor_row(state, table, row, seat, lane)
    if here < 0:
        return int(state.seats.ticket_junction[row, seat]), 0.0
    if state.lanes.junction[lane] >= 0:
        return int(state.lanes.junction[lane]), 0.0
    for ahead in range(here + 1, table.start[table.free + state.route[row, seat] + 1]):
        junction = int(state.lanes.junction[table.lane[ahead]])
        if junction >= 0:
            # The row before is of the road that leads there.
            return junction, max(0.0, table.end[ahead - 1] - state.seats.route_done[row, seat])
    return -1, np.inf
