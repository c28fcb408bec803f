"""What a feature is."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools
from smarts.observations.context import AdapterContext
from smarts.roads.arrays import Roads, RouteTable
from smarts.sensors.protocol import bind_write
from smarts.types.interface import Field
from smarts.types.world import State


class Feature:
    """A part of an observation, such as the speed, computed for agents of all simulations at once.

    A feature is numbers in [-1, 1], which are joined into the vector `observation`. A subclass sets `size`
    and implements `write`, a kernel for one agent, or `bind`, in NumPy for all agents. Its docstring's first
    sentence says what the numbers mean.

    Args:
        context: The agents.
    """

    size: ClassVar[int] = 1
    """How many numbers there are."""
    in_vector: ClassVar[bool] = True
    """False: its fields are observations of their own, beside the vector."""
    arrays: ClassVar[Callable[..., Any] | None] = None
    """A named tuple of the fields' arrays, of a feature with several fields and a kernel."""
    needs_equal_sensors: ClassVar[bool] = False
    """Whether agents need the same sensors with the same options to be observed together."""

    def __init__(self, context: AdapterContext) -> None:
        self.context = context

    @classmethod
    def size_for(cls, agents: int) -> int:
        """Return how many numbers there are in a group of so many agents."""
        return cls.size

    def fields(self) -> tuple[Field, ...]:
        """Return the arrays that it writes."""
        size, meaning = self.size_for(len(self.context.agents)), (self.__doc__ or "").split(".")[0]
        return (Field(type(self).__name__, (size,), np.float32, -1.0, 1.0, "", " ".join(meaning.split())),)

    def known(self) -> tuple[Any, ...]:
        """Return further arguments of `write`: numbers, arrays, named tuples."""
        return ()

    @staticmethod
    def write(
        state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: Any, *known: Any
    ) -> None:
        """Write an agent's numbers; a kernel, as of a `smarts.sensors.protocol.KernelSensor`.

        Args:
            state: Of all simulations; `state.agents.slot[b, a]` is the agent's vehicle.
            roads: The maps; that of the simulation is `state.map[b]`.
            routes: Of all agents.
            b: The simulation.
            g: The agent's place among those that are observed together.
            a: The agent's row of `state.agents`.
            out: Written: the agent's entry of the field's array, shape (size,); with `arrays` the whole
                arrays of all fields, shape (B, G, ...), of which it writes [b, g].
            known: What `known` returns.
        """
        raise NotImplementedError("a feature needs a kernel `write`, or a method `bind`")

    def bind(self, *out: NDArray) -> Callable[[Bools], object]:
        """Return the function that observes: called with `observe_mask`, it writes those agents' entries.

        Entries of agents that are not in the mask stay as they are. The function is called at each decision;
        the arrays of the world are the same in every step.

        Args:
            out: The array of each field, shape (B, G, *shape), for B simulations and G agents. The mask has
                the shape (B, G); each agent in it has a vehicle.
        """
        arrays = out[0] if self.arrays is None else self.arrays(*out)
        return bind_write(self.write, self.context.scene, self.context.agent_ids, arrays, *self.known())
