"""The feature `neighbor_sectors`, and the time to collision that rewards share."""

from __future__ import annotations

import math

import numpy as np

from smarts.arrays import Singles
from smarts.geometry.compiling import kernel
from smarts.observations.feature import Feature
from smarts.observations.scales import LONGEST_TIME, RADIUS, SPEED_SCALE, compressed
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.levels import meets
from smarts.types.vehicles import VehicleStates
from smarts.types.world import State

SECTORS = 8
SECTOR_VALUES = 5
"""Values of each vehicle: nearness, relative speed, urgency, position ahead and to the left."""


@kernel
def _speed_along(vehicles: VehicleStates, b: int, slot: int, dx: float, dy: float) -> float:
    """Return the part of a vehicle's velocity along a vector, times the vector's length [m^2/s]."""
    cosine, sine = math.cos(vehicles.heading[b, slot]), math.sin(vehicles.heading[b, slot])
    ahead, aside = vehicles.speed[b, slot], vehicles.lateral_speed[b, slot]
    return (ahead * cosine - aside * sine) * dx + (ahead * sine + aside * cosine) * dy


@kernel
def distance_and_time(vehicles: VehicleStates, b: int, own: int, other: int) -> tuple[float, float]:
    """Return the distance to a vehicle [m], and the time to collision at the present closing speed [s]."""
    dx = vehicles.position[b, other, 0] - vehicles.position[b, own, 0]
    dy = vehicles.position[b, other, 1] - vehicles.position[b, own, 1]
    distance = math.sqrt(dx * dx + dy * dy)
    closing = _speed_along(vehicles, b, own, dx, dy) - _speed_along(vehicles, b, other, dx, dy)
    closing /= max(distance, 1e-6)
    time = distance / closing if closing > 0.0 else LONGEST_TIME
    return distance, min(time, LONGEST_TIME)


@kernel
def _sector(ahead: float, left: float) -> int:
    """Return the sector that a place lies in."""
    turn = math.atan2(left, ahead) / (2.0 * math.pi) * SECTORS
    return math.floor(turn + 0.5) % SECTORS


class NeighborSectors(Feature):
    """The nearest vehicle within 50 m in each of eight sectors of 45 degrees around the agent's vehicle.

    Sectors are counter-clockwise, the first one centred straight ahead. Of each: 1 - distance / 50 m; speed
    relative to the own one, compressed; 1 - time to collision / 5 s, 0 where the two do not approach;
    position ahead and to the left, compressed. Zeros where a sector is empty.
    """

    size = SECTORS * SECTOR_VALUES

    @staticmethod
    @kernel
    def write(state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: Singles) -> None:
        """Write an agent's numbers; see `Feature`."""
        vehicles, own = state.vehicles, state.agents.slot[b, a]
        cos, sin = math.cos(vehicles.heading[b, own]), math.sin(vehicles.heading[b, own])
        nearest = np.full(SECTORS, RADIUS)
        out[:] = 0.0
        for v in range(vehicles.alive.shape[1]):
            if not meets(vehicles, b, own, v):
                continue
            distance, time = distance_and_time(vehicles, b, own, v)
            dx = vehicles.position[b, v, 0] - vehicles.position[b, own, 0]
            dy = vehicles.position[b, v, 1] - vehicles.position[b, own, 1]
            ahead, left = dx * cos + dy * sin, dy * cos - dx * sin
            # False for NaN, too.
            if distance < RADIUS and distance < nearest[_sector(ahead, left)]:
                sector = _sector(ahead, left)
                first = sector * SECTOR_VALUES
                nearest[sector] = distance
                out[first] = 1.0 - distance / RADIUS
                out[first + 1] = compressed(vehicles.speed[b, v] - vehicles.speed[b, own], SPEED_SCALE)
                out[first + 2] = 1.0 - time / LONGEST_TIME
                out[first + 3] = compressed(ahead, RADIUS)
                out[first + 4] = compressed(left, RADIUS)
