"""Changes of pose from decision to decision."""

from __future__ import annotations

from typing import ClassVar

from smarts.controllers.target_pose import TargetPose
from smarts.types.actions import ActionSpaceType


class RelativeTargetPose(TargetPose):
    """Moves a vehicle by dx, dy [m] along the map's axes and turns it by dheading [rad].

    It does so straight and at one speed, until the agent's next decision. Without one, it stands then.
    """

    action: ClassVar[ActionSpaceType] = ActionSpaceType.RelativeTargetPose
    relative: ClassVar[bool] = True
