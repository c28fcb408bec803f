"""Kernels that limit a vehicle's speed by the vehicles ahead; used by `FallbackController`."""

from __future__ import annotations

import math

import numpy as np

from smarts.arrays import Floats
from smarts.geometry.compiling import kernel
from smarts.types.world import State

STANDSTILL_GAP = 2.5
"""Gap to a standing leader [m]."""
HEADWAY = 1.0
"""Time gap to a moving leader, in addition [s]."""
SIDE_GAP = 0.3
"""Vehicles with more lateral clearance than this are not leaders [m]."""
BRAKING = 3.0
"""Deceleration behind a leader [m/s^2]."""
BESIDE, BEHIND = 5.0, 10.0
"""A vehicle is beside the first part of a reference that comes nearer to it than the one, up to where that is
farther from it than the other [m]: on a small roundabout a reference leads round, past the vehicle again."""


@kernel
def limit_by_leaders(state: State, b: int, slot: int, points: Floats) -> None:
    """Lower a reference's speeds so that the vehicle keeps its distance to vehicles ahead.

    Args:
        state: The state of the world.
        b: The simulation.
        slot: The vehicle.
        points: The reference, shape (R, 4), see `Commands`; its speeds are lowered.
    """
    vehicles = state.vehicles
    reach = 0.0
    for i in range(len(points)):
        reach = max(reach, math.hypot(points[i, 0] - points[0, 0], points[i, 1] - points[0, 1]))
    reach += 10.0
    for other in range(vehicles.alive.shape[1]):
        if other == slot or not vehicles.alive[b, other]:
            continue
        x, y = vehicles.position[b, other, 0], vehicles.position[b, other, 1]
        if abs(x - points[0, 0]) > reach or abs(y - points[0, 1]) > reach:
            continue
        station, distance, turn = _along(points, x, y, vehicles.heading[b, other])
        aside = (
            abs(math.sin(turn)) * vehicles.length[b, other] + abs(math.cos(turn)) * vehicles.width[b, other]
        )
        if station <= 0.0 or distance > 0.5 * (aside + vehicles.width[b, slot]) + SIDE_GAP:
            continue
        gap = station - 0.5 * (vehicles.length[b, other] + vehicles.length[b, slot])
        speed = max(vehicles.speed[b, other] * math.cos(turn), 0.0)
        brake_to(points, gap - STANDSTILL_GAP - HEADWAY * speed, speed)


@kernel
def _along(points: Floats, x: float, y: float, heading: float) -> tuple[float, float, float]:
    """Return station [m], distance [m] and relative heading [rad] of a pose with respect to a reference.

    The station is 0 beside the first point and negative behind it.
    """
    best, best_square, station, best_station = 0, np.inf, 0.0, 0.0
    for i in range(len(points)):
        if i > 0:
            station += math.hypot(points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1])
        square = (points[i, 0] - x) ** 2 + (points[i, 1] - y) ** 2
        if square < best_square:
            best, best_square, best_station = i, square, station
        elif best_square < BESIDE**2 and square > BEHIND**2:
            break
    # Project onto the heading at the nearest point, since far points are widely spaced.
    cos, sin = math.cos(points[best, 2]), math.sin(points[best, 2])
    dx, dy = x - points[best, 0], y - points[best, 1]
    best_station += dx * cos + dy * sin
    return best_station, abs(dy * cos - dx * sin), heading - points[best, 2]


@kernel
def brake_to(points: Floats, gap: float, speed: float) -> None:
    """Lower a reference's speeds so that the vehicle brakes to `speed` [m/s] within `gap` [m]."""
    station = 0.0
    for i in range(len(points)):
        if i > 0:
            station += math.hypot(points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1])
        room = gap - station
        allowed = math.sqrt(speed * speed + 2.0 * BRAKING * room) if room > 0.0 else speed
        if room < 0.0:
            allowed = max(speed + 0.5 * room, 0.0)
        points[i, 3] = min(points[i, 3], allowed)
