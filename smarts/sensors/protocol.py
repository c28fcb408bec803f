"""What a sensor is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from smarts.roads.scene import Scene
from smarts.types.interface import Field

Bools = NDArray[np.bool_]
Ints = NDArray[np.int32]


class Sensor(Protocol):
    """Made from its option in the agent's interface; equal options share one sensor and one block of arrays.

    It remembers nothing: what it needs of the past is in `world.before` and in the agents. Entries of lists
    (vehicles, paths, points) that are not there are zero, and a count says how many are.
    """

    def fields(self) -> tuple[Field, ...]:
        """Return what it fills; values lie within the fields' bounds, whatever the world is like."""
        ...

    def observe(self, scene: Scene, agent_ids: Ints, observe_mask: Bools, out: Mapping[str, NDArray]) -> None:
        """Write the readings of the wanted agents, and leave the others' as they are.

        Args:
            scene: The state to be seen.
            agent_ids: The agents that have this sensor, shape (G,).
            observe_mask: Which of them are to be served, shape (B, G); each holds a vehicle that is alive.
            out: Array of each field, shape (B, G, *shape).
        """
        ...
