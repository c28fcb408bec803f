"""Kernels that limit a vehicle's speed by the vehicles ahead; used by `FallbackController`."""

from __future__ import annotations

import math

import numpy as np

from smarts.arrays import Floats
from smarts.geometry.compiling import kernel
from smarts.roads.levels import meets
from smarts.types.world import State

STANDSTILL_GAP = 2.5
"""Gap to a standing leader [m]."""
HEADWAY = 1.0
"""Time gap to a moving leader, in addition [s]."""
SIDE_GAP = 0.3
"""Vehicles with more lateral clearance than this are not leaders [m]."""
BRAKING = 3.0
"""Deceleration behind a leader [m/s^2]."""


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
        if not meets(vehicles, b, slot, other):
            continue
        x, y = vehicles.position[b, other, 0], vehicles.position[b, other, 1]
        if abs(x - points[0, 0]) > reach or abs(y - points[0, 1]) > reach:
            continue
        station, turn = _first_station(
            points,
            x,
            y,
            vehicles.heading[b, other],
            vehicles.length[b, other],
            vehicles.width[b, other],
            vehicles.width[b, slot],
        )
        if station <= 0.0:
            continue
        gap = station - 0.5 * (vehicles.length[b, other] + vehicles.length[b, slot])
        speed = max(vehicles.speed[b, other] * math.cos(turn), 0.0)
        brake_to(points, gap - STANDSTILL_GAP - HEADWAY * speed, speed)


@kernel
def _first_station(
    points: Floats, x: float, y: float, heading: float, length: float, width: float, own_width: float
) -> tuple[float, float]:
    """Return where a reference first meets a vehicle: station [m], 0 if nowhere, and relative heading [rad].

    It may come near the vehicle several times: on a roundabout in each round, at a U-turn on both lanes.
    """
    nearest, station, is_nearing = 0, 0.0, True
    before = (points[0, 0] - x) ** 2 + (points[0, 1] - y) ** 2
    for i in range(1, len(points) + 1):
        square = np.inf
        if i < len(points):
            dx, dy = points[i, 0] - x, points[i, 1] - y
            square = dx * dx + dy * dy
        if square <= before:
            is_nearing = True
        elif is_nearing:
            is_nearing = False
            k = i - 1
            # Project onto the heading at the nearest point, since far points are widely spaced.
            cos, sin = math.cos(points[k, 2]), math.sin(points[k, 2])
            dx, dy, turn = x - points[k, 0], y - points[k, 1], heading - points[k, 2]
            aside = abs(math.sin(turn)) * length + abs(math.cos(turn)) * width
            if abs(dy * cos - dx * sin) <= 0.5 * (aside + own_width) + SIDE_GAP:
                while nearest < k:
                    nearest += 1
                    station += math.hypot(
                        points[nearest, 0] - points[nearest - 1, 0],
                        points[nearest, 1] - points[nearest - 1, 1],
                    )
                if station + (dx * cos + dy * sin) > 0.0:
                    return station + (dx * cos + dy * sin), turn
        before = square
    return 0.0, 0.0


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
