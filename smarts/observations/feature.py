"""What a feature is."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools, Ints
from smarts.geometry.binding import bind
from smarts.observations.context import AdapterContext
from smarts.roads.arrays import Roads, RouteTable
from smarts.sensors.protocol import looped
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

    @staticmethod
    def write(
        state: State, roads: Roads, routes: RouteTable, agent_ids: Ints, b: int, g: int, out: NDArray
    ) -> None:
        """Write an agent's numbers; a kernel.

        Args:
            state: Of all simulations; `state.agents.slot[b, agent_ids[g]]` is the agent's vehicle.
            roads: The maps; that of the simulation is `state.map[b]`.
            routes: Of all agents.
            agent_ids: The agents that are observed together, shape (G,).
            b: The simulation.
            g: The agent's place in `agent_ids`.
            out: Written, shape (size,).
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
        scene = self.context.scene
        known = scene.world.state, scene.atlas.roads, scene.routes.current, self.context.agent_ids
        return bind(looped(_loop, self.write), *known, *out)


def _loop(state: Any, roads: Any, routes: Any, agent_ids: Any, out: Any, observe_mask: Any) -> None:
    for b in range(observe_mask.shape[0]):
        for g in range(observe_mask.shape[1]):
            if observe_mask[b, g]:
                write(state, roads, routes, agent_ids, b, g, out[b, g])  # type: ignore[name-defined]  # noqa: F821
