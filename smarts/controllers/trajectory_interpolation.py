"""Exact control by a path of poses with times."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from smarts.arrays import Bools, Ints
from smarts.controllers.action_formats import ActionFormat, PathFormat
from smarts.geometry.binding import LateBound
from smarts.geometry.compiling import kernel
from smarts.geometry.timed_paths import pose_at
from smarts.roads.scene import Scene
from smarts.types.actions import Actions, CommandMode, Commands
from smarts.types.world import State

_PLACE, _NONE = int(CommandMode.PLACE), int(CommandMode.NONE)


class TrajectoryInterpolation:
    """Places a vehicle on its path of time, x, y, heading, speed, without its dynamics.

    Times [s] count from the step in which the path is fresh. Poses are interpolated linearly between the
    points. Before the first point the vehicle is at that point; after the last point it continues straight at
    the last speed.

    Args:
        scene: The world, its maps and its routes.
    """

    action_format: ClassVar[ActionFormat] = PathFormat(columns=(0, 1, 2, 3, 4))
    follows_lanes: ClassVar[bool] = False

    def __init__(self, scene: Scene) -> None:
        begin = np.zeros(scene.world.agents.slot.shape, np.int32)
        self.columns = (begin,)
        """First step of each agent's path, cleared when another agent takes its place, shape (B, A)."""
        self._follow = LateBound(follow_times, scene.world.state, begin)

    def command(self, actions: Actions, chosen: Bools, out: Commands) -> None:
        """Write the poses of the chosen agents; see `Controller`."""
        self._follow.to(actions, out)(chosen)


@kernel
def follow_times(state: State, begin: Ints, actions: Actions, commands: Commands, chosen: Bools) -> None:
    """Write poses of chosen agents, interpolated in time.

    Args:
        state: The state of the world.
        begin: First step of each agent's path, written for fresh paths, shape (B, A).
        actions: Actions of all agents.
        commands: Mode and poses are written.
        chosen: The agents, shape (B, A).
    """
    for b in range(chosen.shape[0]):
        for a in range(chosen.shape[1]):
            if not chosen[b, a]:
                continue
            if actions.fresh[b, a]:
                begin[b, a] = state.step[b]
            if actions.path_length[b, a] == 0:
                commands.mode[b, a] = _NONE
                continue
            commands.mode[b, a] = _PLACE
            substeps = commands.poses.shape[2]
            for k in range(substeps):
                now = (state.step[b] - begin[b, a]) * state.dt + (k + 1) * state.dt / substeps
                pose_at(actions.path[b, a], actions.path_length[b, a], now, commands.poses[b, a, k])
