"""The feature `nearby`: the nearest vehicles as boxes with a speed, in SI units."""

from __future__ import annotations

import numpy as np

from smarts.arrays import Floats
from smarts.geometry.compiling import kernel
from smarts.observations.feature import Feature
from smarts.roads.arrays import Roads, RouteTable
from smarts.sensors.nearest import nearest_vehicles
from smarts.types.interface import Field
from smarts.types.world import State

NEARBY = "nearby"
"""Name of the field."""
VEHICLES = 8
"""How many, at most."""
WITHIN = 60.0
"""[m]"""
COLUMNS = 6
"""Values of each vehicle: x, y [m], heading [rad], speed [m/s], length, width [m]."""


class Nearby(Feature):
    """The eight nearest vehicles within 60 m, nearest first, on the map; a length of zero stands for none.

    Of each: x, y of the footprint's centre, heading, speed, length, width.
    """

    in_vector = False

    def fields(self) -> tuple[Field, ...]:
        """Return the rows."""
        meaning = "x, y [m], heading [rad], speed [m/s], length, width [m] of the nearest vehicles"
        return (Field(NEARBY, (VEHICLES, COLUMNS), np.float64, -np.inf, np.inf, "", meaning),)

    @staticmethod
    @kernel
    def write(state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: Floats) -> None:
        """Write an agent's rows, shape (8, 6); see `Feature`."""
        vehicles, own = state.vehicles, state.agents.slot[b, a]
        found, squares = np.empty(VEHICLES, np.int32), np.empty(VEHICLES)
        count = nearest_vehicles(vehicles, b, own, WITHIN, found, squares)
        out[:] = 0.0
        for row in range(count):
            slot = found[row]
            out[row, 0], out[row, 1] = vehicles.position[b, slot]
            out[row, 2], out[row, 3] = vehicles.heading[b, slot], vehicles.speed[b, slot]
            out[row, 4], out[row, 5] = vehicles.length[b, slot], vehicles.width[b, slot]
