"""The feature `action_mask`."""

from __future__ import annotations

import numpy as np

from smarts.arrays import Bytes
from smarts.geometry.compiling import kernel
from smarts.observations.feature import Feature
from smarts.roads.arrays import Roads, RouteTable
from smarts.types.actions import ActionSpaceType, LaneAction
from smarts.types.interface import Field
from smarts.types.world import State

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

    @staticmethod
    @kernel
    def write(state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: Bytes) -> None:
        """Write an agent's mask; see `Feature`."""
        for action in range(len(out)):
            out[action] = state.agents.action_mask[b, a, action]
