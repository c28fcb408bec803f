"""The feature `lane_changes`."""

from __future__ import annotations

from smarts.arrays import Ints, Singles
from smarts.geometry.compiling import kernel
from smarts.observations.feature import Feature
from smarts.observations.scales import MOST_LANE_CHANGES, clipped
from smarts.roads.arrays import Roads, RouteTable
from smarts.types.world import State


class LaneChanges(Feature):
    """Lane changes that the route still demands, in thirds; positive where the first is to the left."""

    @staticmethod
    @kernel
    def write(
        state: State, roads: Roads, routes: RouteTable, agent_ids: Ints, b: int, g: int, out: Singles
    ) -> None:
        """Write an agent's numbers; see `Feature`."""
        out[0] = clipped(state.agents.lane_changes[b, agent_ids[g]] / MOST_LANE_CHANGES)
