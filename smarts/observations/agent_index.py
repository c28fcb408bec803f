"""The feature `agent_index`."""

from __future__ import annotations

from smarts.arrays import Ints, Singles
from smarts.geometry.compiling import kernel
from smarts.observations.feature import Feature
from smarts.roads.arrays import Roads, RouteTable
from smarts.types.world import State


class AgentIndex(Feature):
    """One-hot: which of the agents the agent is."""

    @classmethod
    def size_for(cls, agents: int) -> int:
        """Return one number for each agent."""
        return agents

    @staticmethod
    @kernel
    def write(
        state: State, roads: Roads, routes: RouteTable, agent_ids: Ints, b: int, g: int, out: Singles
    ) -> None:
        """Write an agent's numbers; see `Feature`."""
        out[g] = 1.0
