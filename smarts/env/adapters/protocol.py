"""What an adapter for arrays is."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from smarts.agents.interface import AgentInterface
from smarts.roads.scene import Scene
from smarts.types.actions import ActionSpaceType
from smarts.types.agent_states import AgentStatus
from smarts.types.frame import Frame
from smarts.types.interface import Field

Bools = NDArray[np.bool_]
Ints = NDArray[np.int32]

MASK = "action_mask"
"""Name of the field that says which discrete actions are legal."""


@dataclass(frozen=True)
class AdapterContext:
    """The agents that an adapter serves: some egos that act in the same way."""

    scene: Scene
    agents: tuple[str, ...]
    """Their names."""
    agent_ids: Ints
    """Their agents, shape (G,)."""
    action: ActionSpaceType
    period: int
    """Steps from one decision to the next."""
    max_steps: int
    """Steps up to the time limit, 0 without one."""
    interfaces: tuple[AgentInterface, ...] = ()
    """Theirs; empty where all are like the one that the adapter is made with."""

    def ended(self, frame: Frame) -> Bools:
        """Return whose episode ended in a step, shape (B, G)."""
        return frame.events.just_done[:, self.agent_ids]

    def present(self, frame: Frame) -> Bools:
        """Return who was there in a step, or at a reset, shape (B, G)."""
        is_active = frame.world.agents.state[:, self.agent_ids] == AgentStatus.ACTIVE
        return (is_active & frame.env_mask[:, None]) | self.ended(frame)


class ArrayAdapter(Protocol):
    """Serves some egos of all simulations at once, by kernels: there is no Python per agent.

    A decision lasts several steps. In each, the adapter is shown the frame; at the end of the decision it
    hands out what has come together. Sums over agents or time are taken in a fixed order (kernels, not numpy
    reductions, whose order depends on B). Made by a call with `Served` and the adapter's own options.
    """

    sensors: ClassVar[Collection[str] | None]
    """Names of the sensors whose readings it looks at, among those of its agents; None: all of them. The
    others are not observed."""
    fields: tuple[Field, ...]
    """The observation of one agent. A field `action_mask` says which discrete actions are legal."""

    def collect(self, frame: Frame, is_last: bool) -> object:
        """See one step of a decision, or a reset; `is_last` if the decision ends with it."""
        ...

    def reset(self, egos: Bools) -> None:
        """Forget what is remembered of these egos, shape (B, N); their observations become zero."""
        ...

    @property
    def observations(self) -> Mapping[str, NDArray]:
        """Array of each field, shape (B, G, *shape); an agent that ended keeps its last until the reset."""
        ...

    @property
    def rewards(self) -> NDArray[np.float32]:
        """Of the decision, shape (B, G)."""
        ...
