"""Kernels that say how fast vehicles drive through junctions."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from smarts.arrays import Floats
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import wrapped
from smarts.roads.arrays import Roads
from smarts.roads.kernels import lane_length, pose_on_lane

LATERAL = 3.0
"""Lateral acceleration in turns [m/s^2]."""
CROSSING = 2.0
"""Acceleration through a junction, at most [m/s^2]."""
STEERING_SHARE = 0.95
"""Share of the steering rate that turns use."""
SLOWEST = 2.0
"""Speed in turns, at least [m/s]."""

_BEFORE = 5


class Performance(NamedTuple):
    """What each kind of vehicle can do, shape (K,) unless said otherwise; see `VehicleKind`."""

    acceleration: Floats
    """Acceleration from standstill [m/s^2]."""
    power: Floats
    """Power of the engine, by mass [W/kg]."""
    agility: Floats
    """Maximum rate of change of the curvature, from the steering rate [1/(m s)]."""
    pace: Floats
    """Mean speed on each lane inside junctions, elsewhere its limit [m/s], shape (L, K)."""


@kernel
def acceleration_over(
    performance: Performance, kind: int, distance: float, speed: float, top: float
) -> float:
    """Return the mean acceleration of a vehicle over a distance [m/s^2].

    Args:
        performance: Performance of each kind of vehicle.
        kind: The vehicle's.
        distance: [m]
        speed: At its begin [m/s].
        top: The highest speed [m/s].
    """
    halfway = min(math.sqrt(speed * speed + CROSSING * max(distance, 0.0)), top)
    return min(CROSSING, performance.acceleration[kind], performance.power[kind] / max(halfway, 1.0))


@kernel
def write_paces(roads: Roads, agility: Floats, pace: Floats) -> None:
    """Write how fast each lane is driven by each kind of vehicle.

    Args:
        roads: The maps' lanes.
        agility: See `Performance`, shape (K,).
        pace: Written: see `Performance`, shape (L, K).
    """
    for lane in range(len(pace)):
        pace[lane] = roads.lane_speed[lane]
        if roads.lane_inside[lane]:
            pace[lane] = paces_in(roads, lane, agility)


@kernel
def paces_in(roads: Roads, lane: int, agility: Floats) -> Floats:
    """Return the mean speeds at which kinds of vehicles drive a lane inside a junction [m/s], shape (K,).

    Bends limit them by the lateral acceleration, and where they begin and end by the steering rate.

    Args:
        roads: The maps' lanes.
        lane: The lane.
        agility: See `Performance`, shape (K,).
    """
    limit = roads.lane_speed[lane]
    # Headings every metre, and some before and behind the lane, where the way is straight.
    length = lane_length(roads, lane)
    count = int(length) + 1
    headings = np.empty(count + 2 * _BEFORE)
    for i in range(len(headings)):
        s = min(max(float(i - _BEFORE), 0.0), length)
        headings[i] = pose_on_lane(roads, lane, s)[2]
    taken = np.zeros(len(agility))
    for i in range(_BEFORE, count + _BEFORE):
        bend = abs(wrapped(headings[i + 2] - headings[i - 2])) / 4.0
        ahead, behind = headings[i + 5] - headings[i + 1], headings[i - 1] - headings[i - 5]
        change = abs(wrapped(ahead) - wrapped(behind)) / 24.0
        bent = math.sqrt(LATERAL / max(bend, 1e-4))
        for k in range(len(agility)):
            fastest = min(bent, STEERING_SHARE * agility[k] / max(change, 1e-9))
            taken[k] += 1.0 / min(max(fastest, SLOWEST), limit)
    return np.minimum(count / taken, limit)
