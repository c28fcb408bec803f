"""Driving to a pose by a time."""

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
"""The largest magnitude of a target's heading [rad]."""


class TargetPose:
    """Takes a vehicle along a cubic to x, y [m], heading [rad] in a time [s], whatever its dynamics.

    A target counts once, from the step in which it is fresh; a time of less than a step is a step. After it
    the vehicle continues straight at the speed with which it arrived, which is the mean of its way.

    Args:
        scene: What the controller works in.
    """

    action_format: ClassVar[ActionFormat] = NumbersFormat([-FAR, -FAR, -TURN, 0], [FAR, FAR, TURN, 1000])
    follows_lanes: ClassVar[bool] = False
    relative: ClassVar[bool] = False

    def __init__(self, scene: Scene) -> None:
        # An agent's plan is made by its first action, which is fresh.
        plans = np.zeros((*scene.world.agents.slot.shape, PLAN))
        self.columns = (plans,)
        """Each agent's plan, to be cleared for another agent, shape (B, A, PLAN)."""
        self._place = LateBound(place_by_targets, scene.world.state, int(self.relative), plans)

    def command(self, actions: Actions, chosen: Bools, out: Commands) -> None:
        """Write the poses of the chosen agents; see `Controller`."""
        self._place.to(actions, out)(chosen)
