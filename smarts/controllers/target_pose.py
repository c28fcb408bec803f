"""Control by a target pose and the time to reach it."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from smarts.arrays import Bools
from smarts.controllers.action_formats import FAR, ActionFormat, NumbersFormat
from smarts.controllers.placing import PLAN, place_by_targets
from smarts.geometry.binding import LateBound
from smarts.roads.scene import Scene
from smarts.types.actions import Actions, Commands

TURN = 2 * np.pi
"""Largest magnitude of a target's heading [rad]."""


class TargetPose:
    """Moves a vehicle along a cubic to x, y [m], heading [rad] within a time [s], without its dynamics.

    The plan starts in the step in which the action is fresh; a time shorter than a step becomes one step.
    After its end the vehicle continues straight at its speed of arrival, the mean speed of the plan.

    Args:
        scene: The world, its maps and its routes.
    """

    action_format: ClassVar[ActionFormat] = NumbersFormat([-FAR, -FAR, -TURN, 0], [FAR, FAR, TURN, 1000])
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
