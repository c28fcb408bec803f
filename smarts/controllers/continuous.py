"""Control by throttle, brake, and steering or its rate."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from smarts.arrays import Bools
from smarts.controllers.action_formats import ActionFormat, NumbersFormat
from smarts.roads.scene import Scene
from smarts.types.actions import Actions, CommandMode, Commands

LEAST = (0.0, 0.0, -1.0)
MOST = (1.0, 1.0, 1.0)


class Continuous:
    """Takes throttle and brake in [0, 1] and steering in [-1, 1] of full lock, positive to the left."""

    action_format: ClassVar[ActionFormat] = NumbersFormat(LEAST, MOST)
    follows_lanes: ClassVar[bool] = False
    mode: ClassVar[CommandMode] = CommandMode.ACTUATORS

    def __init__(self, scene: Scene) -> None:
        pass

    def command(self, actions: Actions, chosen: Bools, out: Commands) -> None:
        """Write the actuators of the chosen agents; see `Controller`."""
        out.mode[chosen] = self.mode
        out.actuators[chosen] = np.clip(actions.values[chosen, :3], LEAST, MOST)


class ActuatorDynamic(Continuous):
    """Takes throttle and brake in [0, 1] and the steering rate in [-1, 1], in full locks per second."""

    mode: ClassVar[CommandMode] = CommandMode.ACTUATORS_RATE
