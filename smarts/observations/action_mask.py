"""The feature `action_mask`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools, Bytes, Ints
from smarts.geometry.binding import bind
from smarts.geometry.compiling import kernel
from smarts.observations.feature import Feature
from smarts.types.actions import ActionSpaceType, LaneAction
from smarts.types.agent_states import AgentStates
from smarts.types.interface import Field

MASK = "action_mask"
"""Name of the field that says which discrete actions are allowed."""


class ActionMask(Feature):
    """Which lane actions are allowed; only agents that act by lanes have a mask."""

    in_vector = False

    def fields(self) -> tuple[Field, ...]:
        """Return the mask."""
        meaning = "which lane actions are allowed"
        has_mask = self.context.action == ActionSpaceType.Lane
        return (Field(MASK, (len(LaneAction),), np.int8, 0, 1, "", meaning),) if has_mask else ()

    def bind(self, *out: NDArray) -> Callable[[Bools], object]:
        """Return the function that observes."""
        return bind(_observe, self.context.scene.world.agents, self.context.agent_ids, *out)


@kernel
def _observe(agents: AgentStates, agent_ids: Ints, out: Bytes, observe_mask: Bools) -> None:
    for b in range(observe_mask.shape[0]):
        for g in range(observe_mask.shape[1]):
            if observe_mask[b, g]:
                for action in range(out.shape[2]):
                    out[b, g, action] = agents.action_mask[b, agent_ids[g], action]
