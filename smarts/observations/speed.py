"""The feature `speed`."""

from __future__ import annotations

from smarts.arrays import Ints, Singles
from smarts.geometry.compiling import kernel
from smarts.observations.feature import Feature
from smarts.observations.scales import SPEED_SCALE, clipped
from smarts.roads.arrays import Roads, RouteTable
from smarts.types.world import State


class Speed(Feature):
    """Speed along the heading, in units of 30 m/s."""

    @staticmethod
    @kernel
    def write(
        state: State, roads: Roads, routes: RouteTable, agent_ids: Ints, b: int, g: int, out: Singles
    ) -> None:
        """Write an agent's numbers; see `Feature`."""
        own = state.agents.slot[b, agent_ids[g]]
        out[0] = clipped(state.vehicles.speed[b, own] / SPEED_SCALE)
