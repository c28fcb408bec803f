"""The agent `keep-lane-v0`, and `non-interactive-v0`, which ignores the others."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from smarts.agents.interface import AgentInterface
from smarts.agents.policy import ActionBatch, BatchAgent
from smarts.arrays import Floats, Ints
from smarts.zoo.driving import DRIVER, Driver, Seen

FASTEST = 60.0
"""The largest target speed of the action space [m/s]."""


class KeepLane(Driver):
    """Keeps its lane, wherever that leads, at its distance from the vehicle ahead.

    It never changes lanes and stops where its lane ends.
    """

    def decide(self, batch: ActionBatch, seen: Seen) -> tuple[Floats, Ints]:
        """Return accelerations and no lane changes; see `Driver`."""
        return self.follow(seen, keeps_to_route=False), np.zeros(len(seen.own), np.int32)


class NonInteractive(BatchAgent):
    """Keeps its lane at a constant speed and ignores lights and vehicles.

    Args:
        speed: [m/s], at most 60.
    """

    interface: ClassVar[AgentInterface] = DRIVER
    observation: ClassVar[Any] = ["speed"]

    def __init__(self, speed: float = 10.0) -> None:
        # The original's files ask for 80 m/s.
        self._speed = min(float(speed), FASTEST)

    def act(self, obs: ActionBatch) -> NDArray:
        """Return target speeds and no lane changes, shape (N, 2)."""
        return np.tile([self._speed, 0.0], (len(obs.env_id), 1))
