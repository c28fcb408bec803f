"""The feature `steering`."""

from __future__ import annotations

from smarts.arrays import Ints, Singles
from smarts.geometry.compiling import kernel
from smarts.observations.feature import Feature
from smarts.observations.scales import STEERING_SCALE, clipped
from smarts.roads.arrays import Roads, RouteTable
from smarts.types.world import State


class Steering(Feature):
    """Angle of the front wheels, positive to the left, in units of 0.6 rad."""

    @staticmethod
    @kernel
    def write(
        state: State, roads: Roads, routes: RouteTable, agent_ids: Ints, b: int, g: int, out: Singles
    ) -> None:
        """Write an agent's numbers; see `Feature`."""
        out[0] = clipped(state.agents.steering[b, agent_ids[g]] / STEERING_SCALE)
