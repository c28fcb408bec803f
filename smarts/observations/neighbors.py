"""The feature `neighbors`, and the search that rewards share."""

from __future__ import annotations

import math

import numpy as np

from smarts.arrays import Floats, Ints, Singles
from smarts.geometry.compiling import kernel
from smarts.observations.feature import Feature
from smarts.observations.scales import RADIUS, SPEED_SCALE, compressed
from smarts.roads.arrays import Roads, RouteTable
from smarts.sensors.nearest import nearest_vehicles
from smarts.types.vehicles import VehicleStates
from smarts.types.world import State

NEIGHBORS = 8
NEIGHBOR_VALUES = 5
"""Values of each vehicle: nearness, position ahead and to the left, relative velocity ahead and left."""


@kernel
def velocity(vehicles: VehicleStates, b: int, slot: int) -> tuple[float, float]:
    """Return a vehicle's velocity along x and y [m/s]."""
    cos, sin = math.cos(vehicles.heading[b, slot]), math.sin(vehicles.heading[b, slot])
    speed, aside = vehicles.speed[b, slot], vehicles.lateral_speed[b, slot]
    return speed * cos - aside * sin, speed * sin + aside * cos


@kernel
def neighbors_within(
    vehicles: VehicleStates, b: int, own: int, radius: float, found: Ints, squares: Floats
) -> int:
    """List the nearest vehicles nearer than `radius` [m]; see `nearest_vehicles`."""
    count = nearest_vehicles(vehicles, b, own, radius, found, squares)
    while count > 0 and squares[count - 1] >= radius * radius:
        count -= 1
    return count


class Neighbors(Feature):
    """The eight nearest vehicles within 50 m, nearest first, as seen from the agent's vehicle.

    Of each: 1 - distance / 50 m; compressed: position ahead and to the left, velocity relative to the own one
    ahead and to the left. Of equally near vehicles the one of the lower slot comes first.
    """

    size = NEIGHBORS * NEIGHBOR_VALUES

    @staticmethod
    @kernel
    def write(state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: Singles) -> None:
        """Write an agent's numbers; see `Feature`."""
        vehicles, own = state.vehicles, state.agents.slot[b, a]
        found, squares = np.empty(NEIGHBORS, np.int32), np.empty(NEIGHBORS)
        count = neighbors_within(vehicles, b, own, RADIUS, found, squares)
        x, y = vehicles.position[b, own, 0], vehicles.position[b, own, 1]
        cos, sin = math.cos(vehicles.heading[b, own]), math.sin(vehicles.heading[b, own])
        own_vx, own_vy = velocity(vehicles, b, own)
        out[:] = 0.0
        for place in range(count):
            slot, first = found[place], place * NEIGHBOR_VALUES
            dx, dy = vehicles.position[b, slot, 0] - x, vehicles.position[b, slot, 1] - y
            vx, vy = velocity(vehicles, b, slot)
            vx, vy = vx - own_vx, vy - own_vy
            out[first] = 1.0 - math.sqrt(squares[place]) / RADIUS
            out[first + 1] = compressed(dx * cos + dy * sin, RADIUS)
            out[first + 2] = compressed(dy * cos - dx * sin, RADIUS)
            out[first + 3] = compressed(vx * cos + vy * sin, SPEED_SCALE)
            out[first + 4] = compressed(vy * cos - vx * sin, SPEED_SCALE)
