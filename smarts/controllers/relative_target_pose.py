"""Changes of pose from decision to decision."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from smarts.controllers.action_formats import ActionFormat, NumbersFormat
from smarts.controllers.target_pose import TargetPose


class RelativeTargetPose(TargetPose):
    """Moves a vehicle by dx, dy [m] along the map's axes and turns it by dheading [rad].

    It does so straight and at one speed, until the agent's next decision. Without one, it stands then.
    """

    action_format: ClassVar[ActionFormat] = NumbersFormat([-6, -6, -np.pi], [6, 6, np.pi])
    relative: ClassVar[bool] = True
