"""The feature `speed`."""

from __future__ import annotations

from collections.abc import Callable

from numpy.typing import NDArray

from smarts.arrays import Bools, Ints, Singles
from smarts.geometry.binding import bind
from smarts.geometry.compiling import kernel
from smarts.observations.feature import Feature
from smarts.observations.scales import SPEED_SCALE, clipped
from smarts.types.agent_states import AgentStates
from smarts.types.vehicles import VehicleStates


class Speed(Feature):
    """Speed along the heading, in units of 30 m/s."""

    def bind(self, *out: NDArray) -> Callable[[Bools], object]:
        """Return the function that observes."""
        world = self.context.scene.world
        return bind(_observe, world.agents, world.vehicles, self.context.agent_ids, *out)


@kernel
def _observe(
    agents: AgentStates, vehicles: VehicleStates, agent_ids: Ints, out: Singles, observe_mask: Bools
) -> None:
    for b in range(observe_mask.shape[0]):
        for g in range(observe_mask.shape[1]):
            if observe_mask[b, g]:
                own = agents.slot[b, agent_ids[g]]
                out[b, g, 0] = clipped(vehicles.speed[b, own] / SPEED_SCALE)
