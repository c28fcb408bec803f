"""The numbers that stand once in an agent's vector, behind the instants: who it is, what ends its episode.

Axis letters: B simulations, G agents of the adapter, A seats, L lanes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from smarts.env.adapters.features import Driving, Seated, clipped, path_ahead
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.lights import light_ahead
from smarts.types.seats import SeatState

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Ints = NDArray[np.int32]
Bytes = NDArray[np.int8]
Bools = NDArray[np.bool_]

ARRIVAL, LANE_CHANGES, RESTED, LIGHT = -1, -2, -3, -4
"""Places from the end of the vector of numbers that are there once, not for each instant."""
SITUATION = 4
"""How many they are."""

LIGHTS = np.array([0.0, -1.0, -0.5, 1.0])
"""What stands for each `Signal`."""
MOST_LANE_CHANGES = 3
"""More count as so many."""

_ACTIVE = int(SeatState.ACTIVE)


@kernel
def write_arrival_order(
    seats: Ints, state: Bytes, ticket: Ints, junction: Ints, vectors: Singles, chosen: Bools
) -> None:
    """Write, as the last number of each vector, how many agents came to the agent's next junction before it.

    It is the share of the other agents; -1 for who has not come to a junction.

    Args:
        seats: The adapter's agents, shape (G,).
        state: Of all seats, shape (B, A), as the columns of `Seats` that follow.
        ticket: Place in the order of arrival, -1 without one.
        junction: That the ticket is for.
        vectors: Written, shape (B, G, at least 1).
        chosen: Whom to write, shape (B, G).
    """
    others = max(len(seats) - 1, 1)
    last = vectors.shape[2] - 1
    for b in range(chosen.shape[0]):
        for g in range(len(seats)):
            if not chosen[b, g]:
                continue
            own = seats[g]
            if ticket[b, own] < 0:
                vectors[b, g, last] = -1.0
                continue
            earlier = 0
            for other in seats:
                is_here = state[b, other] == _ACTIVE and ticket[b, other] >= 0
                if is_here and junction[b, other] == junction[b, own]:
                    earlier += ticket[b, other] < ticket[b, own]
            vectors[b, g, last] = earlier / others


@kernel
def write_situation(
    roads: Roads,
    table: RouteTable,
    maps: Ints,
    routes: Ints,
    seats: Ints,
    seated: Seated,
    driving: Driving,
    signals: Bytes,
    step: Ints,
    patience: Floats,
    vectors: Singles,
    chosen: Bools,
) -> None:
    """Write what the end of an agent's episode depends on beside what it sees around it.

    That is the light at the end of its lane (`LIGHTS`), the share of the time that it may stand which it has
    stood, and the lane changes that its route demands, in thirds, positive where the first is to the left.

    Args:
        roads: The maps' lanes.
        table: The routes.
        maps: Map of each simulation, shape (B,).
        routes: Number of each seat's route in the table, shape (B, A).
        seats: The adapter's agents, shape (G,).
        seated: Of all seats.
        driving: All vehicles.
        signals: Of all lanes, shape (B, L).
        step: Of each episode, shape (B,).
        patience: How long each agent may stand [steps]; infinite if for ever, shape (G,).
        vectors: Written, near their ends, shape (B, G, at least `SITUATION`).
        chosen: Whom to write, shape (B, G).
    """
    for b in range(chosen.shape[0]):
        for g in range(len(seats)):
            if not chosen[b, g]:
                continue
            seat, vector = seats[g], vectors[b, g]
            lane = driving.lane[b, seated.slot[b, seat]]
            vector[LIGHT] = 0.0
            if lane >= 0:
                base, free, done = roads.lane_base[maps[b]], table.start[maps[b]], seated.route_done[b, seat]
                here = path_ahead(roads, table, base, maps[b], routes[b, seat], lane, done)
                vector[LIGHT] = LIGHTS[light_ahead(table, here, base, free, signals[b])]
            vector[RESTED] = min(1.0, (step[b] - seated.rest_step[b, seat]) / patience[g])
            vector[LANE_CHANGES] = clipped(seated.lane_changes[b, seat] / MOST_LANE_CHANGES)


@kernel
def write_identity(first: int, vectors: Singles, chosen: Bools) -> None:
    """Mark in the chosen agents' vectors, shape (B, G, ...), from `first` on, which of the G one is."""
    for b in range(chosen.shape[0]):
        for g in range(chosen.shape[1]):
            if chosen[b, g]:
                vectors[b, g, first + g] = 1.0


@kernel
def write_mask(seats: Ints, legal: Bools, mask: Bytes, chosen: Bools) -> None:
    """Copy which actions are legal, of all seats, shape (B, A, L), to the mask of the chosen ones."""
    for b in range(chosen.shape[0]):
        for g in range(len(seats)):
            if chosen[b, g]:
                for action in range(mask.shape[2]):
                    mask[b, g, action] = legal[b, seats[g], action]
