"""The feature `steering`."""

from __future__ import annotations

from collections.abc import Callable

from numpy.typing import NDArray

from smarts.arrays import Bools, Ints, Singles
from smarts.geometry.binding import bind
from smarts.geometry.compiling import kernel
from smarts.observations.feature import Feature
from smarts.observations.scales import STEERING_SCALE, clipped
from smarts.types.agent_states import AgentStates


class Steering(Feature):
    """Angle of the front wheels, positive to the left, in units of 0.6 rad."""

    def bind(self, *out: NDArray) -> Callable[[Bools], object]:
        """Return the function that observes."""
        return bind(_observe, self.context.scene.world.agents, self.context.agent_ids, *out)


@kernel
def _observe(agents: AgentStates, agent_ids: Ints, out: Singles, observe_mask: Bools) -> None:
    for b in range(observe_mask.shape[0]):
        for g in range(observe_mask.shape[1]):
            if observe_mask[b, g]:
                out[b, g, 0] = clipped(agents.steering[b, agent_ids[g]] / STEERING_SCALE)
