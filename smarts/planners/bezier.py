"""A cubic Bezier curve to the target pose, driven so that the vehicle arrives at the target's time."""

from __future__ import annotations

import math

import numpy as np

from smarts.arrays import Floats
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import segment_at
from smarts.planners.protocol import Limits, Neighbours, Plans, keep_last
from smarts.roads.curves import bends_of, curve_between, pose_along, stations_of

_LONGER_HANDLES = (1.0, 1.25, 1.5, 2.0, 2.5, 3.0)
"""Multiples of the handles that are tried, until the vehicle can drive the curve."""
_SLOWEST = 0.01
"""Speed at which a vehicle waits for its time [m/s]."""
_HALVINGS = 60
"""Number of halvings of the interval in which the cruising speed is searched for."""


class BezierPlanner:
    """Plans one curve from pose to pose, without regard to neighbours.

    The handles of the curve are those of the circular arc that turns by as much over the same chord; they
    are lengthened where the vehicle cannot drive the curve. Along the curve the vehicle accelerates, cruises
    and brakes within its limits and below the speed of its largest lateral acceleration. The cruising speed
    is the one with which it arrives at the target's time at the target's speed; where that is too early for
    its limits, it arrives as soon as it can. Planning fails where every curve is too sharp for the vehicle.

    Args:
        limits: The vehicle.
        points: Rows of a path.

    After Scheiderer, Thun and Meisen, "Bezier curve based continuous and smooth motion planning for
    self-learning industrial robots", 2019.
    """

    def __init__(self, limits: Limits | None = None, points: int = 32) -> None:
        self._limits = limits or Limits()
        self._points = points

    def plan(
        self,
        states: Floats,
        targets: Floats,
        neighbours: Neighbours | None = None,
        last: Floats | None = None,
        elapsed: float | Floats = 0.0,
    ) -> Plans:
        """Plan a path for each vehicle; see `Planner`."""
        limits = self._limits
        bounds = np.array([limits.speed, limits.acceleration, limits.braking, limits.lateral])
        path, bends = bezier_paths(states, targets, bounds, limits.sharpest, self._points)
        failed = ~(np.isfinite(path).all(axis=(1, 2)) & (bends <= limits.sharpest))
        return keep_last(path, failed, last, np.broadcast_to(np.asarray(elapsed, float), len(states)))


@kernel
def bezier_paths(
    states: Floats, targets: Floats, bounds: Floats, sharpest: float, points: int
) -> tuple[Floats, Floats]:
    """Return the paths along Bezier curves and the curves' sharpest bends [1/m].

    Args:
        states: x, y, heading, speed of the vehicles, shape (N, 4 or more).
        targets: Time, x, y, heading, speed, shape (N, 5).
        bounds: Largest speed, acceleration, deceleration, lateral acceleration.
        sharpest: Curvature up to which the handles are not lengthened [1/m].
        points: Rows of a path.

    Returns:
        Shape (N, points, 5), of NaN for numbers that are not finite, and (N,).
    """
    paths, sharp = np.full((len(states), points, 5), np.nan), np.full(len(states), np.inf)
    for n in range(len(states)):
        if np.isfinite(states[n]).all() and np.isfinite(targets[n]).all():
            control, stations, bends = drivable_curve(states[n], targets[n, 1:4], sharpest)
            sharp[n] = bends.max()
            speeds = speeds_in_time(stations, bends, states[n, 3], targets[n, 4], targets[n, 0], bounds)
            _drive(control, stations, speeds, paths[n])
    return paths, sharp


@kernel
def drivable_curve(begin: Floats, end: Floats, sharpest: float) -> tuple[Floats, Floats, Floats]:
    """Return the curve with the shortest handles that bends no more than `sharpest`, or the least bent one.

    Returns:
        The control points, shape (4, 2), the stations [m] and the bends [1/m], shape (PIECES + 1,) each.
    """
    control = curve_between(begin, end[0], end[1], end[2], _LONGER_HANDLES[0])
    stations = stations_of(control)
    bends = bends_of(control, stations)
    for longer in _LONGER_HANDLES[1:]:
        if bends.max() <= sharpest:
            break
        other = curve_between(begin, end[0], end[1], end[2], longer)
        other_stations = stations_of(other)
        other_bends = bends_of(other, other_stations)
        if other_bends.max() < bends.max():
            control, stations, bends = other, other_stations, other_bends
    return control, stations, bends


@kernel
def speeds_in_time(
    stations: Floats, bends: Floats, begin: float, end: float, time: float, bounds: Floats
) -> Floats:
    """Return the speeds along a curve that take the wanted time, or the least time that the bounds allow.

    Args:
        stations: Length of the curve up to each point [m], shape (Q,).
        bends: Curvature there [1/m], shape (Q,).
        begin: Speed at its begin [m/s].
        end: Speed at its end, where the bounds allow it [m/s].
        time: From begin to end [s].
        bounds: Largest speed, acceleration, deceleration, lateral acceleration.
    """
    slow, fast = _SLOWEST, bounds[0]
    for _ in range(_HALVINGS):
        middle = 0.5 * (slow + fast)
        if duration(stations, speeds_below(stations, bends, begin, end, middle, bounds)) > time:
            slow = middle
        else:
            fast = middle
    return speeds_below(stations, bends, begin, end, fast, bounds)


@kernel
def speeds_below(
    stations: Floats, bends: Floats, begin: float, end: float, cruise: float, bounds: Floats
) -> Floats:
    """Return the speeds along a curve of a vehicle that cruises at a speed, within bounds, shape (Q,).

    It exceeds the cruising speed only to reach the speed at the end, and the bounds of speed only while it
    brakes as hard as it may. Arguments are those of `speeds_in_time`.
    """
    most, acceleration, braking, lateral = bounds
    count = len(stations)
    speeds = np.empty(count)
    for i in range(count):
        left = stations[count - 1] - stations[i]
        wanted = max(cruise, math.sqrt(max(end * end - 2.0 * acceleration * left, 0.0)))
        speeds[i] = min(min(wanted, most), math.sqrt(lateral / max(bends[i], 1e-9)))
    speeds[0] = min(speeds[0], begin)
    speeds[count - 1] = min(speeds[count - 1], end)
    for i in range(count - 2, -1, -1):
        way = stations[i + 1] - stations[i]
        speeds[i] = min(speeds[i], math.sqrt(speeds[i + 1] ** 2 + 2.0 * braking * way))
    speeds[0] = begin
    for i in range(1, count):
        way = stations[i] - stations[i - 1]
        most_there = math.sqrt(speeds[i - 1] ** 2 + 2.0 * acceleration * way)
        least_there = math.sqrt(max(speeds[i - 1] ** 2 - 2.0 * braking * way, 0.0))
        speeds[i] = max(min(speeds[i], most_there), least_there)
    return speeds


@kernel
def duration(stations: Floats, speeds: Floats) -> float:
    """Return how long a drive takes whose acceleration is even between the points [s]."""
    time = 0.0
    for i in range(len(stations) - 1):
        time += 2.0 * (stations[i + 1] - stations[i]) / max(speeds[i] + speeds[i + 1], _SLOWEST)
    return time


@kernel
def _drive(control: Floats, stations: Floats, speeds: Floats, path: Floats) -> None:
    """Write time, x, y, heading, speed along a curve, evenly in time."""
    whole = duration(stations, speeds)
    times = np.zeros(len(stations))
    for i in range(1, len(stations)):
        way = stations[i] - stations[i - 1]
        times[i] = times[i - 1] + 2.0 * way / max(speeds[i - 1] + speeds[i], _SLOWEST)
    for p in range(len(path)):
        now = whole * p / (len(path) - 1)
        i = segment_at(times, 0, len(times), now)
        step = max(times[i + 1] - times[i], 1e-9)
        share = min((now - times[i]) / step, 1.0)
        speed = speeds[i] + share * (speeds[i + 1] - speeds[i])
        station = stations[i] + share * step * 0.5 * (speeds[i] + speed)
        x, y, heading = pose_along(control, stations, station)
        path[p, 0], path[p, 1], path[p, 2], path[p, 3], path[p, 4] = now, x, y, heading, speed
