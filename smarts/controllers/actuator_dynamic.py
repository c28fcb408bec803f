"""Direct control of throttle and brake, and of how fast the steering turns."""

from __future__ import annotations

from typing import ClassVar

from smarts.controllers.continuous import Continuous
from smarts.types.actions import CommandMode


class ActuatorDynamic(Continuous):
    """Passes on throttle and brake in [0, 1] and the rate of steering in locks a second, [-1, 1]."""

    mode: ClassVar[CommandMode] = CommandMode.ACTUATORS_RATE
