"""Driving to a pose by a time."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from smarts.controllers.action_formats import FAR, ActionFormat, NumbersFormat
from smarts.controllers.placing import PLAN, place_by_targets
from smarts.roads.scene import Scene
from smarts.types.actions import Actions, Commands

Bools = NDArray[np.bool_]

TURN = 2 * np.pi
"""The largest magnitude of a target's heading [rad]."""


class TargetPose:
    """Takes a vehicle along a cubic to x, y [m], heading [rad] in a time [s], whatever its dynamics.

    A target counts once, from the step in which it is fresh; a time of less than a step is a step. After it
    the vehicle goes on straight at the speed with which it arrived, which is the mean of its way.

    Args:
        scene: What the controller works in.
    """

    action_format: ClassVar[ActionFormat] = NumbersFormat([-FAR, -FAR, -TURN, 0], [FAR, FAR, TURN, 1000])
    follows_lanes: ClassVar[bool] = False
    relative: ClassVar[bool] = False

    def __init__(self, scene: Scene) -> None:
        # An agent's plan is made by its first action, which is fresh, so nothing is to be reset.
        self._plans = np.zeros((*scene.world.agents.slot.shape, PLAN))

    def command(self, scene: Scene, actions: Actions, chosen: Bools, out: Commands) -> None:
        """Write the poses of the chosen agents; see `Controller`."""
        world = scene.world
        vehicles = world.vehicles
        place_by_targets(
            chosen,
            actions.fresh,
            self.relative,
            actions.values,
            world.agents.slot,
            world.agents.period,
            world.step,
            world.dt,
            vehicles.position,
            vehicles.heading,
            vehicles.speed,
            self._plans,
            out.mode,
            out.poses,
        )
