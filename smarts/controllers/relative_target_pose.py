"""Control by changes of pose."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from smarts.controllers.action_formats import ActionFormat, NumbersFormat
from smarts.controllers.target_pose import TargetPose


class RelativeTargetPose(TargetPose):
    """Moves a vehicle by dx, dy [m] along the map's axes and turns it by dheading [rad].

    The vehicle moves straight and at constant speed, and arrives at the agent's next decision. Without a new
    action it then stands still.
    """

    action_format: ClassVar[ActionFormat] = NumbersFormat([-6, -6, -np.pi], [6, 6, np.pi])
    relative: ClassVar[bool] = True
