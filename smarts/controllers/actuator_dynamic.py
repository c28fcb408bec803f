"""Control by throttle, brake and steering rate."""

from __future__ import annotations

from typing import ClassVar

from smarts.controllers.continuous import Continuous
from smarts.types.actions import CommandMode


class ActuatorDynamic(Continuous):
    """Takes throttle and brake in [0, 1] and the steering rate in [-1, 1], in full locks per second."""

    mode: ClassVar[CommandMode] = CommandMode.ACTUATORS_RATE
