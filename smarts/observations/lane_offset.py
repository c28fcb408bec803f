"""The feature `lane_offset`."""

from __future__ import annotations

from smarts.arrays import Ints, Singles
from smarts.geometry.compiling import kernel
from smarts.observations.feature import Feature
from smarts.observations.scales import clipped
from smarts.roads.arrays import Roads, RouteTable
from smarts.types.world import State


class LaneOffset(Feature):
    """Distance to the left of the lane's centreline, in widths of the lane; 0 without a lane."""

    @staticmethod
    @kernel
    def write(
        state: State, roads: Roads, routes: RouteTable, agent_ids: Ints, b: int, g: int, out: Singles
    ) -> None:
        """Write an agent's numbers; see `Feature`."""
        own = state.agents.slot[b, agent_ids[g]]
        lane = state.vehicles.lane[b, own]
        out[0] = 0.0
        if lane >= 0:
            width = roads.lane_width[roads.lane_base[state.map[b]] + lane]
            out[0] = clipped(state.vehicles.lane_offset[b, own] / width)
