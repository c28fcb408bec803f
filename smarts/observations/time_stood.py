"""The feature `time_stood`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from smarts.agents.interface import AgentInterface
from smarts.arrays import Bools, Floats, Ints, Singles
from smarts.geometry.binding import bind
from smarts.geometry.compiling import kernel
from smarts.observations.feature import Feature
from smarts.types.agent_states import AgentStates


class TimeStood(Feature):
    """Time at a standstill, as a share of the time that ends the agent's episode; 0 if none does."""

    def bind(self, *out: NDArray) -> Callable[[Bools], object]:
        """Return the function that observes."""
        world, context = self.context.scene.world, self.context
        limits = np.array([_limit(interface, world.dt) for interface in context.interfaces])
        return bind(_observe, world.agents, world.step, limits, context.agent_ids, *out)


def _limit(interface: AgentInterface, dt: float) -> float:
    """Return the steps at a standstill that end an agent's episode, infinite if none do."""
    if not interface.done_criteria.not_moving:
        return np.inf
    return max(1.0, interface.event_configuration.not_moving_time / dt)


@kernel
def _observe(
    agents: AgentStates, step: Ints, limits: Floats, agent_ids: Ints, out: Singles, observe_mask: Bools
) -> None:
    for b in range(observe_mask.shape[0]):
        for g in range(observe_mask.shape[1]):
            if observe_mask[b, g]:
                stood = step[b] - agents.last_moved_step[b, agent_ids[g]]
                out[b, g, 0] = min(1.0, stood / limits[g])
