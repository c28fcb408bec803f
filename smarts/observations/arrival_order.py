"""The feature `arrival_order`."""

from __future__ import annotations

from collections.abc import Callable

from numpy.typing import NDArray

from smarts.arrays import Bools, Ints, Singles
from smarts.geometry.binding import bind
from smarts.geometry.compiling import kernel
from smarts.observations.feature import Feature
from smarts.types.agent_states import AgentStates, AgentStatus

_ACTIVE = int(AgentStatus.ACTIVE)


class ArrivalOrder(Feature):
    """The share of the other agents that came to the junction ahead before; -1 away from junctions."""

    def bind(self, *out: NDArray) -> Callable[[Bools], object]:
        """Return the function that observes."""
        return bind(_observe, self.context.scene.world.agents, self.context.agent_ids, *out)


@kernel
def _observe(agents: AgentStates, agent_ids: Ints, out: Singles, observe_mask: Bools) -> None:
    others = max(len(agent_ids) - 1, 1)
    for b in range(observe_mask.shape[0]):
        for g in range(observe_mask.shape[1]):
            if not observe_mask[b, g]:
                continue
            own, earlier = agent_ids[g], 0
            if agents.arrival_number[b, own] < 0:
                out[b, g, 0] = -1.0
                continue
            for other in agent_ids:
                is_here = agents.state[b, other] == _ACTIVE and agents.arrival_number[b, other] >= 0
                if is_here and agents.arrival_junction[b, other] == agents.arrival_junction[b, own]:
                    earlier += agents.arrival_number[b, other] < agents.arrival_number[b, own]
            out[b, g, 0] = earlier / others
