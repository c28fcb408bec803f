"""Target poses of an agent that has several vehicles."""

from __future__ import annotations

from typing import ClassVar

from smarts.controllers.target_pose import TargetPose
from smarts.types.actions import ActionSpaceType


class MultiTargetPose(TargetPose):
    """As `TargetPose`: each of the agent's vehicles has an agent, and its target stands there."""

    action: ClassVar[ActionSpaceType] = ActionSpaceType.MultiTargetPose
