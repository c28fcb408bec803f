"""What agents' interfaces ask of the step: the fields of observations, and the rules for each agent."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bytes, Floats, Ints
from smarts.types.actions import ActionSpaceType
from smarts.types.events import Event


@dataclass(frozen=True)
class Field:
    """One array of an observation: buffers, spaces, clipping and documentation are all made from it."""

    name: str
    shape: tuple[int, ...]
    dtype: type[np.generic]
    low: float
    """The least value; kernels clip to the bounds."""
    high: float
    unit: str
    """Such as "m/s"; "" for numbers without one."""
    meaning: str

    def allocate(self, *leading: int) -> NDArray:
        """Return zeros of the shape (*leading, *shape)."""
        return np.zeros((*leading, *self.shape), self.dtype)


ENDING = (
    Event.COLLISION
    | Event.OFF_ROAD
    | Event.OFF_ROUTE
    | Event.REACHED_GOAL
    | Event.MISSED_GOAL
    | Event.REACHED_MAX_EPISODE_STEPS
)
"""The events that end an agent's episode unless its interface says otherwise."""


class AgentRules(NamedTuple):
    """The rules of each agent's interface, the same in all simulations during the whole run; shape (A,)."""

    action: Bytes
    """An `ActionSpaceType`."""
    ending: Ints
    """The `Event` bits that end the agent's episode."""
    max_steps: Ints
    """Steps from entry to the time limit, 0 for none."""
    not_moving_steps: Ints
    """Steps within a circle after which the agent counts as not moving."""
    not_moving_distance: Floats
    """Radius of that circle [m]."""

    @classmethod
    def allocate(cls, agents: int) -> AgentRules:
        """Return the default rules for A agents."""
        return cls(
            action=np.full(agents, ActionSpaceType.Empty, np.int8),
            ending=np.full(agents, ENDING, np.int32),
            max_steps=np.zeros(agents, np.int32),
            not_moving_steps=np.full(agents, 600, np.int32),
            not_moving_distance=np.ones(agents),
        )
