"""Changes of pose from step to step."""

from __future__ import annotations

from typing import ClassVar

from smarts.controllers.target_pose import TargetPose
from smarts.types.actions import ActionSpaceType


class RelativeTargetPose(TargetPose):
    """Moves a vehicle by dx, dy [m] along the map's axes and turns it by dheading [rad], in one step."""

    action: ClassVar[ActionSpaceType] = ActionSpaceType.RelativeTargetPose
    relative: ClassVar[bool] = True
