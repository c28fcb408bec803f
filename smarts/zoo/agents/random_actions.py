"""The agent `random-v0`."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from smarts.agents.interface import AgentInterface
from smarts.agents.policy import ActionBatch, BatchAgent
from smarts.types.streams import uniform
from smarts.zoo.driving import DRIVER


class RandomActions(BatchAgent):
    """Draws a target speed and a lane change twice a second.

    Args:
        max_speed: Largest target speed [m/s].
        change: Probability of a change to the left, and of one to the right.
    """

    interface: ClassVar[AgentInterface] = DRIVER
    observation: ClassVar[Any] = ["speed"]
    period: ClassVar[int] = 5

    def __init__(self, max_speed: float = 15.0, change: float = 0.1) -> None:
        self._max_speed, self._change = float(max_speed), float(change)

    def act(self, obs: ActionBatch) -> NDArray:
        """Return target speeds and lane changes, shape (N, 2)."""
        drawn = uniform(obs.seed, obs.step, 2)
        change = np.where(drawn[:, 1] < self._change, 1.0, 0.0)
        change[drawn[:, 1] > 1.0 - self._change] = -1.0
        return np.column_stack([self._max_speed * drawn[:, 0], change])
