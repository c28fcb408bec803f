"""The feature `lane_offset`."""

from __future__ import annotations

from collections.abc import Callable

from numpy.typing import NDArray

from smarts.arrays import Bools, Ints, Singles
from smarts.geometry.binding import bind
from smarts.geometry.compiling import kernel
from smarts.observations.feature import Feature
from smarts.observations.scales import clipped
from smarts.roads.arrays import Roads
from smarts.types.agent_states import AgentStates
from smarts.types.vehicles import VehicleStates


class LaneOffset(Feature):
    """Distance to the left of the lane's centreline, in widths of the lane; 0 without a lane."""

    def bind(self, *out: NDArray) -> Callable[[Bools], object]:
        """Return the function that observes."""
        scene = self.context.scene
        state = scene.world.agents, scene.world.vehicles, scene.atlas.roads, scene.world.map
        return bind(_observe, *state, self.context.agent_ids, *out)


@kernel
def _observe(
    agents: AgentStates,
    vehicles: VehicleStates,
    roads: Roads,
    maps: Ints,
    agent_ids: Ints,
    out: Singles,
    observe_mask: Bools,
) -> None:
    for b in range(observe_mask.shape[0]):
        for g in range(observe_mask.shape[1]):
            if not observe_mask[b, g]:
                continue
            own = agents.slot[b, agent_ids[g]]
            lane = vehicles.lane[b, own]
            out[b, g, 0] = 0.0
            if lane >= 0:
                width = roads.lane_width[roads.lane_base[maps[b]] + lane]
                out[b, g, 0] = clipped(vehicles.lane_offset[b, own] / width)
