"""The feature `arrival_order`."""

from __future__ import annotations

from smarts.arrays import Ints, Singles
from smarts.geometry.compiling import kernel
from smarts.observations.feature import Feature
from smarts.roads.arrays import Roads, RouteTable
from smarts.types.agent_states import AgentStatus
from smarts.types.world import State

_ACTIVE = int(AgentStatus.ACTIVE)


class ArrivalOrder(Feature):
    """The share of the other agents that came to the junction ahead before; -1 away from junctions."""

    @staticmethod
    @kernel
    def write(
        state: State, roads: Roads, routes: RouteTable, agent_ids: Ints, b: int, g: int, out: Singles
    ) -> None:
        """Write an agent's numbers; see `Feature`."""
        agents, own, earlier = state.agents, agent_ids[g], 0
        if agents.arrival_number[b, own] < 0:
            out[0] = -1.0
            return
        for other in agent_ids:
            is_here = agents.state[b, other] == _ACTIVE and agents.arrival_number[b, other] >= 0
            if is_here and agents.arrival_junction[b, other] == agents.arrival_junction[b, own]:
                earlier += agents.arrival_number[b, other] < agents.arrival_number[b, own]
        out[0] = earlier / max(len(agent_ids) - 1, 1)
