"""The feature `agent_index`."""

from __future__ import annotations

from collections.abc import Callable

from numpy.typing import NDArray

from smarts.arrays import Bools, Singles
from smarts.geometry.binding import bind
from smarts.geometry.compiling import kernel
from smarts.observations.feature import Feature


class AgentIndex(Feature):
    """One-hot: which of the agents the agent is."""

    @classmethod
    def size_for(cls, agents: int) -> int:
        """Return one number for each agent."""
        return agents

    def bind(self, *out: NDArray) -> Callable[[Bools], object]:
        """Return the function that observes."""
        return bind(_observe, *out)


@kernel
def _observe(out: Singles, observe_mask: Bools) -> None:
    for b in range(observe_mask.shape[0]):
        for g in range(observe_mask.shape[1]):
            if observe_mask[b, g]:
                out[b, g, g] = 1.0
