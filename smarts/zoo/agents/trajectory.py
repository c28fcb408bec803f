"""The agent `trajectory-v0`."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from smarts.agents.interface import AgentInterface
from smarts.agents.policy import ActionBatch, BatchAgent
from smarts.arrays import Floats
from smarts.controllers.action_formats import PATH_POINTS
from smarts.errors import SmartsError, shown
from smarts.observations.surroundings import OWN_VEHICLE, Own
from smarts.types.actions import ActionSpaceType
from smarts.zoo.driving import DRIVER, STEP, Memory


class TrajectoryPlayer(BatchAgent):
    """Plays poses that are given, one after another, and stands at the last one.

    Args:
        poses: Rows of x, y [m] and, optionally, heading [rad], shape (T, 2) or (T, 3); or a file with them,
            .npy or .csv (numbers separated by commas, lines that begin with # are left out).
        interval: Time from one pose to the next [s].
        relative: Whether x is ahead and y to the left of the pose at which the vehicle is when it begins.

    Raises:
        SmartsError: The poses are not such numbers, or the file cannot be read.
    """

    interface: ClassVar[AgentInterface] = DRIVER.replace(action=ActionSpaceType.TrajectoryWithTime)
    observation: ClassVar[Any] = ["surroundings"]
    step_length: ClassVar[float] = STEP

    def __init__(self, poses: Any, interval: float = STEP, relative: bool = False) -> None:
        self._poses, self._interval, self._relative = _poses(poses), float(interval), bool(relative)
        self._poses[:, 3] /= self._interval
        self._begin = Memory(4)

    def act(self, obs: ActionBatch) -> NDArray:
        """Return paths of time, x, y, heading, speed from now on, shape (N, 5, P)."""
        own, begin = obs.observations[OWN_VEHICLE], self._begin.of(obs)
        is_new = self._begin.is_new(obs)
        begin[is_new, 0] = obs.step[is_new]
        begin[is_new, 1:] = own[is_new][:, [Own.X, Own.Y, Own.HEADING]]
        self._begin.keep(obs, begin)
        ahead = np.arange(PATH_POINTS) * self._interval
        elapsed = (obs.step - begin[:, 0]) * STEP
        paths = np.empty((len(own), 5, PATH_POINTS))
        paths[:, 0] = ahead
        for row, since in enumerate(elapsed):
            paths[row, 1:] = self._poses_at(since + ahead)
            if self._relative:
                paths[row, 1:4] = _placed(paths[row, 1:4], begin[row, 1:])
        return paths

    def _poses_at(self, times: Floats) -> Floats:
        """Return x, y, heading and speed at some times, shape (4, P); the last pose has no speed."""
        own_times = np.arange(len(self._poses)) * self._interval
        x, y, heading, speed = (np.interp(times, own_times, column) for column in self._poses.T)
        return np.stack([x, y, heading, np.where(times < own_times[-1], speed, 0.0)])


def _placed(poses: Floats, begin: Floats) -> Floats:
    """Return x, y, heading, shape (3, P), that were given relative to a pose."""
    cos, sin = np.cos(begin[2]), np.sin(begin[2])
    x = begin[0] + poses[0] * cos - poses[1] * sin
    y = begin[1] + poses[0] * sin + poses[1] * cos
    return np.stack([x, y, np.angle(np.exp(1j * (poses[2] + begin[2])))])


def _poses(given: Any) -> Floats:
    """Return x, y, continuous heading and speed [metres an interval] of each pose, shape (T, 4)."""
    place = "TrajectoryPlayer.poses"
    if isinstance(given, str | Path):
        given, place = _read(Path(given)), str(given)
    try:
        poses: NDArray = np.array(given, np.float64)
    except (TypeError, ValueError):
        poses = np.empty((0, 0))
    is_table = poses.ndim == 2 and len(poses) > 1 and poses.shape[-1] in (2, 3)
    if not is_table or not np.isfinite(poses).all():
        raise SmartsError(
            f"{shown(given)} are no poses",
            place=place,
            remedy="give two or more finite rows of x, y or x, y, heading",
        )
    steps = np.diff(poses[:, :2], axis=0)
    if poses.shape[-1] == 2:
        heading = np.arctan2(steps[:, 1], steps[:, 0])
        poses = np.column_stack([poses, [*heading, heading[-1]]])
    poses[:, 2] = np.unwrap(poses[:, 2])
    speed = np.hypot(steps[:, 0], steps[:, 1])
    return np.column_stack([poses, [*speed, speed[-1]]])


def _read(file: Path) -> NDArray:
    try:
        if file.suffix == ".npy":
            return np.load(file, allow_pickle=False)
        return np.loadtxt(file, delimiter=",", ndmin=2)
    except (OSError, ValueError) as error:
        raise SmartsError(
            f"cannot be read: {error}", place=str(file), remedy="give a .npy or .csv file with poses"
        ) from error
