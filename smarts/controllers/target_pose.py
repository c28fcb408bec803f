"""Control by target poses, with the time to reach them, and by changes of pose."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from smarts.arrays import Bools, Floats
from smarts.controllers.action_formats import FAR, ActionFormat, NumbersFormat, rejection
from smarts.controllers.placing import PLAN, place_by_targets
from smarts.geometry.binding import LateBound
from smarts.roads.scene import Scene
from smarts.types.actions import Actions, Commands

BOUNDS = [-FAR, -FAR, -2 * np.pi, 0], [FAR, FAR, 2 * np.pi, 1000]
"""Lowest and highest target: x, y [m], heading [rad], time [s]."""


class TargetPose:
    """Moves a vehicle along a cubic to x, y [m], heading [rad] within a time [s], without its dynamics.

    The plan starts in the step in which the action is fresh; a time shorter than a step becomes one step.
    After its end the vehicle continues straight at its speed of arrival, the mean speed of the plan.

    Args:
        scene: The world, its maps and its routes.
    """

    action_format: ClassVar[ActionFormat] = NumbersFormat(*BOUNDS)
    follows_lanes: ClassVar[bool] = False
    relative: ClassVar[bool] = False

    def __init__(self, scene: Scene) -> None:
        # An agent's first action is fresh and makes its plan.
        plans = np.zeros((*scene.world.agents.slot.shape, PLAN))
        self.columns = (plans,)
        """Each agent's plan, cleared when another agent takes its place, shape (B, A, PLAN)."""
        self._place = LateBound(place_by_targets, scene.world.state, int(self.relative), plans)

    def command(self, actions: Actions, chosen: Bools, out: Commands) -> None:
        """Write the poses of the chosen agents; see `Controller`."""
        self._place.to(actions, out)(chosen)


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

    action_format: ClassVar[ActionFormat] = PoseByVehicle(*BOUNDS)


class RelativeTargetPose(TargetPose):
    """Moves a vehicle by dx, dy [m] along the map's axes and turns it by dheading [rad].

    The vehicle moves straight and at constant speed, and arrives at the agent's next decision. Without a new
    action it then stands still.
    """

    action_format: ClassVar[ActionFormat] = NumbersFormat([-6, -6, -np.pi], [6, 6, np.pi])
    relative: ClassVar[bool] = True
