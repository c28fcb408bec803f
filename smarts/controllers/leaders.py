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
    last, counted, station, is_nearing = len(points) - 1, 0, 0.0, True
    square = (points[0, 0] - x) ** 2 + (points[0, 1] - y) ** 2
    for i in range(len(points)):
        following = np.inf
        if i < last:
            following = (points[i + 1, 0] - x) ** 2 + (points[i + 1, 1] - y) ** 2
        if is_nearing and following > square:
            # Project onto the heading at the nearest point, since far points are widely spaced.
            cos, sin = math.cos(points[i, 2]), math.sin(points[i, 2])
            dx, dy, turn = x - points[i, 0], y - points[i, 1], heading - points[i, 2]
            aside = abs(math.sin(turn)) * length + abs(math.cos(turn)) * width
            if abs(dy * cos - dx * sin) <= 0.5 * (aside + own_width) + SIDE_GAP:
                while counted < i:
                    counted += 1
                    station += math.hypot(
                        points[counted, 0] - points[counted - 1, 0],
                        points[counted, 1] - points[counted - 1, 1],
                    )
                if station + (dx * cos + dy * sin) > 0.0:
                    return station + (dx * cos + dy * sin), turn
        is_nearing, square = following <= square, following
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
