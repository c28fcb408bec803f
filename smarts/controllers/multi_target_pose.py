"""Control by target poses per vehicle."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from smarts.arrays import Floats
from smarts.controllers.action_formats import FAR, ActionFormat, NumbersFormat, rejection
from smarts.controllers.target_pose import TURN, TargetPose


class PoseByVehicle(NumbersFormat):
    """The format of a `TargetPose` action, or of a mapping from the agent's vehicle to it, as in SMARTS."""

    def parse(self, action: Any, place: str, most_points: int) -> Floats:
        """Return x, y [m], heading [rad], time [s]; see `ActionFormat`."""
        if isinstance(action, Mapping):
            if len(action) != 1:
                problem = f"has poses of {len(action)} vehicles"
                raise rejection(action, problem, place, "give that of the agent's vehicle")
            (action,) = action.values()
        return super().parse(action, place, most_points)


class MultiTargetPose(TargetPose):
    """Drives the agent's vehicle to a target pose, given per vehicle; see `TargetPose`."""

    action_format: ClassVar[ActionFormat] = PoseByVehicle([-FAR, -FAR, -TURN, 0], [FAR, FAR, TURN, 1000])
