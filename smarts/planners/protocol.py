"""What every planner takes and returns: arrays with a row per vehicle."""

from __future__ import annotations

import enum
import math
from typing import NamedTuple, Protocol

import numpy as np

from smarts.arrays import Bools, Bytes, Floats
from smarts.planners.paths import resample
from smarts.types.actions import PATH_COLUMNS


class Limits(NamedTuple):
    """A kind of vehicle: its size, and what its plans may ask of it. The defaults are a passenger car's."""

    length: float = 5.0
    """Length of the footprint [m]."""
    width: float = 2.0
    """Width of the footprint [m]."""
    wheelbase: float = 2.7
    """Distance between the axles [m]; the footprint's centre is midway between them."""
    speed: float = 20.0
    """Largest speed [m/s]."""
    acceleration: float = 2.5
    """Largest acceleration [m/s^2]."""
    braking: float = 5.0
    """Largest deceleration [m/s^2]."""
    lateral: float = 3.0
    """Largest lateral acceleration, v^2 times the curvature [m/s^2]."""
    steering: float = 0.55
    """Largest steering angle [rad]."""
    steering_rate: float = 0.6
    """Largest rate of the steering angle [rad/s]."""

    @property
    def sharpest(self) -> float:
        """Largest curvature of the path of the footprint's centre [1/m]."""
        return 2.0 * math.sin(math.atan(0.5 * math.tan(self.steering))) / self.wheelbase

    def turning(self, curvature: float) -> Limits:
        """Return the same limits, with the steering angle that drives a largest curvature [1/m]."""
        slip = math.asin(0.5 * self.wheelbase * curvature)
        return self._replace(steering=math.atan(2.0 * math.tan(slip)))


class Neighbours(NamedTuple):
    """The predicted motion of the vehicles around each of N vehicles."""

    path: Floats
    """Rows of time [s] from now, x, y [m], heading [rad], speed [m/s], shape (N, K, P, 5). Between the rows
    a neighbour moves evenly, after the last row straight at its speed, so one row is a prediction at constant
    velocity. A neighbour with a number that is not finite is absent."""
    size: Floats
    """Length and width [m], shape (N, K, 2)."""

    @classmethod
    def none(cls, rows: int) -> Neighbours:
        """Return no neighbours for N vehicles."""
        return cls(np.zeros((rows, 0, 1, PATH_COLUMNS)), np.zeros((rows, 0, 2)))


class PlanStatus(enum.IntEnum):
    """Where a path comes from."""

    PLANNED = 0
    """It was planned in this call."""
    SHIFTED = 1
    """Planning failed: it is the rest of the last path."""
    FAILED = 2
    """Planning failed and the last path is over: it is NaN, and the caller's fallback has to drive."""


class Plans(NamedTuple):
    """The result of a call, a row per vehicle."""

    path: Floats
    """Rows of time [s] from now, x, y [m], heading [rad], speed [m/s], as in `Actions.path`; (N, P, 5)."""
    status: Bytes
    """A `PlanStatus`, shape (N,)."""


class Planner(Protocol):
    """Plans paths to targets. It holds no state of vehicles: the caller keeps the last paths."""

    def plan(
        self,
        states: Floats,
        targets: Floats,
        neighbours: Neighbours | None = None,
        last: Floats | None = None,
        elapsed: float | Floats = 0.0,
    ) -> Plans:
        """Plan a path for each of N vehicles. A row's result does not depend on the other rows.

        Args:
            states: x, y [m] of the footprint's centre, heading [rad], speed [m/s], curvature of the path
                driven now [1/m] (yaw rate / speed; 0 if unknown), shape (N, 5).
            targets: Time [s] from now, x, y [m], heading [rad], speed [m/s], shape (N, 5).
            neighbours: The vehicles around each vehicle; None stands for none.
            last: The paths of the last call, shape (N, P, 5): what the planner begins with, and what is
                driven on when it fails. Rows of NaN, or None, stand for none.
            elapsed: Since the last call [s], a number or shape (N,).

        """
        ...


def keep_last(path: Floats, failed: Bools, last: Floats | None, elapsed: Floats) -> Plans:
    """Return plans in which the rows that failed hold the rest of their last paths.

    Args:
        path: The planned paths, overwritten where planning failed, shape (N, P, 5).
        failed: Whether planning failed, shape (N,).
        last: The paths of the last call, or None.
        elapsed: Since the last call [s], shape (N,).
    """
    status = np.where(failed, PlanStatus.FAILED, PlanStatus.PLANNED).astype(np.int8)
    path[failed] = np.nan
    if last is not None and failed.any():
        # NaN compares as False: a row without a last path has no rest.
        rest = last[:, -1, 0] - elapsed
        kept = np.flatnonzero(failed & (rest > 0.0) & np.isfinite(last).all(axis=(1, 2)))
        times = np.linspace(0.0, rest[kept], path.shape[1], axis=1)
        path[kept] = resample(last[kept], times + elapsed[kept, None])
        path[kept, :, 0] = times
        status[kept] = PlanStatus.SHIFTED
    return Plans(path, status)
