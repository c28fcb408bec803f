"""The order in which agents arrive at a junction."""

from __future__ import annotations

import numpy as np

from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.sim.places import corridor_row, lane_of
from smarts.types.agent_states import AgentStatus
from smarts.types.world import State

NEAR = 40.0
"""An agent arrives when it is this far from a junction [m]."""

_ACTIVE = int(AgentStatus.ACTIVE)
_DONE = int(AgentStatus.DONE)


@kernel
def assign_arrival_order(state: State, roads: Roads, routes: RouteTable, row: int) -> None:
    """Write `arrival_number` and `arrival_junction` of the agents in one simulation.

    An agent gets a number within `NEAR` of a junction and keeps it until it has left the junction. Lower
    numbers arrived earlier. Agents that arrive in the same step are ordered by distance, then by agent_id. An
    agent that is DONE keeps its number for that step.
    """
    agents = state.agents
    count = agents.slot.shape[1]
    distance = np.full(count, np.inf)
    for agent_id in range(count):
        if agents.state[row, agent_id] == _DONE:
            continue
        junction, ahead = -1, np.inf
        if agents.state[row, agent_id] == _ACTIVE and agents.slot[row, agent_id] >= 0:
            junction, ahead = _next_junction(state, roads, routes, row, agent_id)
            if ahead > NEAR:
                junction = -1
        if junction != agents.arrival_junction[row, agent_id]:
            agents.arrival_number[row, agent_id], agents.arrival_junction[row, agent_id] = -1, junction
            if junction >= 0:
                distance[agent_id] = ahead
    for _ in range(count):
        agent_id = int(np.argmin(distance))
        if distance[agent_id] == np.inf:
            break
        agents.arrival_number[row, agent_id] = _next_number(
            state, row, agents.arrival_junction[row, agent_id]
        )
        distance[agent_id] = np.inf


@kernel
def _next_number(state: State, row: int, junction: int) -> int:
    """Return the number after those of all agents that have one for a junction."""
    highest = -1
    for agent_id in range(state.agents.arrival_number.shape[1]):
        if state.agents.arrival_junction[row, agent_id] == junction:
            highest = max(highest, state.agents.arrival_number[row, agent_id])
    return highest + 1


@kernel
def _next_junction(
    state: State, roads: Roads, routes: RouteTable, row: int, agent_id: int
) -> tuple[int, float]:
    """Return the junction that the agent is in, else the next on its route, and how far it is [m].

    Off its route, the agent keeps the junction that it has a number for.
    """
    lane = lane_of(state, roads, state.vehicles, row, state.agents.slot[row, agent_id])
    here = corridor_row(state, routes, row, agent_id, lane)
    if here < 0:
        return int(state.agents.arrival_junction[row, agent_id]), 0.0
    if roads.lane_junction[lane] >= 0:
        return int(roads.lane_junction[lane]), 0.0
    for ahead in range(here + 1, routes.start[routes.free + routes.number[row, agent_id] + 1]):
        junction = int(roads.lane_junction[routes.lane[ahead]])
        if junction >= 0:
            # The row before is of the road that leads there.
            return junction, max(0.0, routes.end[ahead - 1] - state.agents.route_progress[row, agent_id])
    return -1, np.inf
