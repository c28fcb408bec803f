"""The feature `lane_changes`."""

from __future__ import annotations

from collections.abc import Callable

from numpy.typing import NDArray

from smarts.arrays import Bools, Ints, Singles
from smarts.geometry.binding import bind
from smarts.geometry.compiling import kernel
from smarts.observations.feature import Feature
from smarts.observations.scales import MOST_LANE_CHANGES, clipped
from smarts.types.agent_states import AgentStates


class LaneChanges(Feature):
    """Lane changes that the route still demands, in thirds; positive where the first is to the left."""

    def bind(self, *out: NDArray) -> Callable[[Bools], object]:
        """Return the function that observes."""
        return bind(_observe, self.context.scene.world.agents, self.context.agent_ids, *out)


@kernel
def _observe(agents: AgentStates, agent_ids: Ints, out: Singles, observe_mask: Bools) -> None:
    for b in range(observe_mask.shape[0]):
        for g in range(observe_mask.shape[1]):
            if observe_mask[b, g]:
                out[b, g, 0] = clipped(agents.lane_changes[b, agent_ids[g]] / MOST_LANE_CHANGES)
