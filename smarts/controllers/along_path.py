"""Control of the speed alone, along the path that a vehicle was recorded on."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from smarts.arrays import Bools, Floats
from smarts.controllers.action_formats import ActionFormat, NumbersFormat
from smarts.recordings.log import lane_path
from smarts.roads.scene import Scene
from smarts.types.actions import Actions, CommandMode, Commands

HARDEST, MOST = 10.0, 5.0
"""Largest deceleration and acceleration of an action [m/s^2]."""
MOVED = 1e-6
"""A vehicle that is farther from where it was put is another one, or was driven by others [m]."""
BEYOND = 200.0
"""Paths go on straight so far beyond their end [m]."""


class AlongPath:
    """Moves a vehicle along its recorded path, without its dynamics; braking stops at standstill.

    A vehicle that was not recorded follows its lane to the map's end. Values: (acceleration [m/s^2],).

    Args:
        scene: The world and its maps.
    """

    action_format: ClassVar[ActionFormat] = NumbersFormat([-HARDEST], [MOST])
    follows_lanes: ClassVar[bool] = False

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        shape = scene.world.agents.slot.shape
        self._s, self._put = np.zeros(shape), np.full((*shape, 2), np.inf)
        """Where each vehicle is on its path [m], and where it was put in the last step."""
        self.columns = self._s, self._put
        self._paths: dict[tuple[int, int], Floats] = {}
        """Path of each agent as points x, y, heading, arc length, by simulation and agent."""

    def command(self, actions: Actions, chosen: Bools, out: Commands) -> None:
        """Write the poses of the chosen agents; see `Controller`."""
        out.mode[chosen] = CommandMode.PLACE
        world = self._scene.world
        vehicles, substeps = world.vehicles, out.poses.shape[2]
        times = world.dt / substeps * np.arange(1, substeps + 1)
        for b, a in np.argwhere(chosen).tolist():
            slot = int(world.agents.slot[b, a])
            if np.abs(vehicles.position[b, slot] - self._put[b, a]).max() > MOVED:
                self._begin(b, a, slot)
            points, speed = self._paths[b, a], float(vehicles.speed[b, slot])
            acceleration = float(actions.values[b, a, 0])
            moving = times if acceleration >= 0.0 else np.minimum(times, max(speed, 0.0) / -acceleration)
            s = self._s[b, a] + (speed + 0.5 * acceleration * moving) * moving
            out.poses[b, a, :, :3] = np.column_stack([np.interp(s, points[:, 3], x) for x in points[:, :3].T])
            out.poses[b, a, :, 2] = np.pi - (np.pi - out.poses[b, a, :, 2]) % (2.0 * np.pi)
            out.poses[b, a, :, 3] = speed + acceleration * moving
            self._s[b, a], self._put[b, a] = s[-1], out.poses[b, a, -1, :2]

    def _begin(self, b: int, a: int, slot: int) -> None:
        """Find an agent's path, and the place of its vehicle there."""
        world = self._scene.world
        vehicles = world.vehicles
        points = world.paths[b].get((slot, int(vehicles.generation[b, slot])))
        if points is None:
            points = lane_path(self._scene.atlas.graphs[world.map[b]], int(vehicles.lane[b, slot])).points(0)
        x, y, turn, end = points[-1]
        beyond = x + BEYOND * np.cos(turn), y + BEYOND * np.sin(turn), turn, end + BEYOND
        points = np.concatenate([points, [beyond]])
        begin, way = points[:-1, :2], np.diff(points[:, :2], axis=0)
        ahead = vehicles.position[b, slot] - begin
        share = np.clip((ahead * way).sum(axis=1) / (way * way).sum(axis=1), 0.0, 1.0)
        nearest = int(np.hypot(*(ahead - share[:, None] * way).T).argmin())
        self._s[b, a] = points[nearest, 3] + share[nearest] * (points[nearest + 1, 3] - points[nearest, 3])
        self._paths[b, a] = points
