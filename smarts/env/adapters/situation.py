"""The numbers that stand once in an agent's vector, behind the instants: who it is, what ends its episode.

Axis letters: B simulations, G agents of the adapter, A agents, L lanes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from smarts.env.adapters.features import Driving, EgoColumns, clipped, path_ahead
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.lights import light_ahead
from smarts.types.agent_states import AgentStatus

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

_ACTIVE = int(AgentStatus.ACTIVE)


@kernel
def write_arrival_order(
    agent_ids: Ints, state: Bytes, arrival_number: Ints, junction: Ints, vectors: Singles, chosen: Bools
) -> None:
    """Write, as the last number of each vector, how many agents came to the agent's next junction before it.

    It is the share of the other agents; -1 for who has not come to a junction.

    Args:
        agent_ids: The adapter's agents, shape (G,).
        state: Of all agents, shape (B, A), as the columns of `AgentStates` that follow.
        arrival_number: Place in the order of arrival, -1 without one.
        junction: That the ticket is for.
        vectors: Written, shape (B, G, at least 1).
        chosen: Whom to write, shape (B, G).
    """
    others = max(len(agent_ids) - 1, 1)
    last = vectors.shape[2] - 1
    for b in range(chosen.shape[0]):
        for g in range(len(agent_ids)):
            if not chosen[b, g]:
                continue
            own = agent_ids[g]
            if arrival_number[b, own] < 0:
                vectors[b, g, last] = -1.0
                continue
            earlier = 0
            for other in agent_ids:
                is_here = state[b, other] == _ACTIVE and arrival_number[b, other] >= 0
                if is_here and junction[b, other] == junction[b, own]:
                    earlier += arrival_number[b, other] < arrival_number[b, own]
            vectors[b, g, last] = earlier / others


@kernel
def write_situation(
    roads: Roads,
    table: RouteTable,
    maps: Ints,
    routes: Ints,
    agent_ids: Ints,
    egos_now: EgoColumns,
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
        routes: Number of each agent's route in the table, shape (B, A).
        agent_ids: The adapter's agents, shape (G,).
        egos_now: Of all agents.
        driving: All vehicles.
        signals: Of all lanes, shape (B, L).
        step: Of each episode, shape (B,).
        patience: How long each agent may stand [steps]; infinite if for ever, shape (G,).
        vectors: Written, near their ends, shape (B, G, at least `SITUATION`).
        chosen: Whom to write, shape (B, G).
    """
    for b in range(chosen.shape[0]):
        for g in range(len(agent_ids)):
            if not chosen[b, g]:
                continue
            agent_id, vector = agent_ids[g], vectors[b, g]
            lane = driving.lane[b, egos_now.slot[b, agent_id]]
            vector[LIGHT] = 0.0
            if lane >= 0:
                base, free, done = (
                    roads.lane_base[maps[b]],
                    table.start[maps[b]],
                    egos_now.route_progress[b, agent_id],
                )
                here = path_ahead(roads, table, base, maps[b], routes[b, agent_id], lane, done)
                vector[LIGHT] = LIGHTS[light_ahead(table, here, base, free, signals[b])]
            vector[RESTED] = min(1.0, (step[b] - egos_now.last_moved_step[b, agent_id]) / patience[g])
            vector[LANE_CHANGES] = clipped(egos_now.lane_changes[b, agent_id] / MOST_LANE_CHANGES)


@kernel
def write_identity(first: int, vectors: Singles, chosen: Bools) -> None:
    """Mark in the chosen agents' vectors, shape (B, G, ...), from `first` on, which of the G one is."""
    for b in range(chosen.shape[0]):
        for g in range(chosen.shape[1]):
            if chosen[b, g]:
                vectors[b, g, first + g] = 1.0


@kernel
def write_mask(agent_ids: Ints, action_mask: Bools, mask: Bytes, chosen: Bools) -> None:
    """Copy which actions are legal, of all agents, shape (B, A, L), to the mask of the chosen ones."""
    for b in range(chosen.shape[0]):
        for g in range(len(agent_ids)):
            if chosen[b, g]:
                for action in range(mask.shape[2]):
                    mask[b, g, action] = action_mask[b, agent_ids[g], action]
