"""Control by a path that the vehicle tracks."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from smarts.arrays import Bools, Floats
from smarts.controllers.action_formats import ActionFormat, PathFormat
from smarts.geometry.binding import LateBound
from smarts.geometry.compiling import kernel
from smarts.roads.scene import Scene
from smarts.types.actions import Actions, CommandMode, Commands
from smarts.types.world import State

BRAKING = 3.0
"""Deceleration beyond the end of a path [m/s^2]."""
BEYOND = 2.0
"""Spacing of the points beyond the end of a path [m]."""

_TRACK = int(CommandMode.TRACK)


class TrajectoryTracking:
    """Tracks a path of x, y, heading, speed from the point nearest to the vehicle.

    The path is fixed on the map: it is tracked until the agent gives another one. Beyond its end the vehicle
    continues straight and brakes to a standstill.
    """

    action_format: ClassVar[ActionFormat] = PathFormat(columns=(1, 2, 3, 4))
    follows_lanes: ClassVar[bool] = False

    def __init__(self, scene: Scene) -> None:
        self._write = LateBound(write_paths, scene.world.state)

    def command(self, actions: Actions, chosen: Bools, out: Commands) -> None:
        """Write the part of each chosen agent's path that lies ahead; see `Controller`."""
        self._write.to(actions, out)(chosen)


@kernel
def write_paths(state: State, actions: Actions, commands: Commands, chosen: Bools) -> None:
    """Write references along `actions.path`, beginning with the point before the nearest one."""
    vehicles = state.vehicles
    for b in range(chosen.shape[0]):
        for a in range(chosen.shape[1]):
            if not chosen[b, a]:
                continue
            commands.mode[b, a], commands.reference_length[b, a] = _TRACK, 0
            given, points = actions.path[b, a], commands.reference[b, a]
            count = actions.path_length[b, a]
            if count == 0:
                continue
            first = _nearest(
                given,
                count,
                vehicles.position[b, state.agents.slot[b, a], 0],
                vehicles.position[b, state.agents.slot[b, a], 1],
            )
            first = max(first - 1, 0)
            kept = min(count - first, len(points))
            for i in range(kept):
                for column in range(3):
                    points[i, column] = given[first + i, column + 1]
                # No vehicle is driven backwards.
                points[i, 3] = max(given[first + i, 4], 0.0)
            extend_path(points, kept)
            commands.reference_length[b, a] = len(points)


@kernel
def _nearest(path: Floats, count: int, x: float, y: float) -> int:
    best, best_square = 0, np.inf
    for i in range(count):
        square = (path[i, 1] - x) ** 2 + (path[i, 2] - y) ** 2
        if square < best_square:
            best, best_square = i, square
    return best


@kernel
def extend_path(points: Floats, count: int) -> None:
    """Extend a reference beyond its first `count` points: straight, braking to a standstill."""
    for i in range(count, len(points)):
        x, y, heading, speed = points[i - 1]
        points[i, 0] = x + BEYOND * math.cos(heading)
        points[i, 1] = y + BEYOND * math.sin(heading)
        points[i, 2] = heading
        points[i, 3] = math.sqrt(max(speed * speed - 2.0 * BRAKING * BEYOND, 0.0))
