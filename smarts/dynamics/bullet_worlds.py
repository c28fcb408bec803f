"""Bullet's worlds of all simulations, each stepped only when vehicles may touch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from smarts.arrays import Longs
from smarts.dynamics.bullet import Box, BulletWorld
from smarts.dynamics.free_motion import find_near
from smarts.dynamics.layout import FleetArrays
from smarts.geometry.binding import bind

Rows = Longs


class BulletWorlds:
    """The bodies of a fleet, in one world for each simulation.

    A world takes 29 MB, so that a simulation has one only once a vehicle moves in Bullet there. A skipped
    world is outdated, because kernels move its bodies; it is synchronised before its next step.

    Args:
        fleet: Fleet of all vehicles; see `BulletWorld`.
        simulations: B.
    """

    def __init__(self, fleet: FleetArrays, simulations: int) -> None:
        self._fleet, self._egos = fleet, len(fleet.cars) // simulations
        self._worlds: dict[int, BulletWorld] = {}
        self.moving: Sequence[BulletWorld] = ()
        """The worlds that run in this step."""
        self._with_boxes = np.zeros(simulations, np.bool_)
        self._near = np.zeros(simulations, np.bool_)
        self._outdated = np.zeros(simulations, np.bool_)
        places = fleet.cars, fleet.bodies, self._with_boxes, fleet.step, self._near
        self._find_near = bind(find_near, *places)

    def close(self) -> None:
        """Free the worlds."""
        for world in self._worlds.values():
            world.close()

    def clear(self, simulation: int) -> None:
        """Remove all bodies of a simulation, and Bullet's memory of them."""
        if simulation in self._worlds:
            self._worlds[simulation].clear()
        self._with_boxes[simulation] = self._outdated[simulation] = False

    def add(self, row: int) -> None:
        """Add a vehicle; see `BulletWorld.add`."""
        self._world(row // self._egos).add(row, self._fleet.cars[row])

    def remove(self, row: int) -> None:
        """Remove a vehicle."""
        self._worlds[row // self._egos].remove(row)

    def place_boxes(self, simulation: int, boxes: Mapping[int, Box]) -> None:
        """Set the boxes of a simulation; see `BulletWorld.place_boxes`."""
        self._world(simulation).place_boxes(boxes)
        self._with_boxes[simulation] = bool(boxes)

    def part(self, rows: Rows) -> tuple[Rows, Rows]:
        """Return the vehicles that touch nothing in the coming step, and the vehicles that may.

        The worlds of the latter are synchronised and in `moving`.

        Args:
            rows: Vehicles in Bullet that are to move, in ascending order, shape (R,).
        """
        simulation = rows // self._egos
        if not self._find_near(rows):
            self._outdated[simulation] = True
            self.moving = ()
            return rows, rows[:0]
        may_touch = self._near[simulation]
        numbers = np.unique(simulation[may_touch])
        for number in numbers[self._outdated[numbers]].tolist():
            self._worlds[number].put()
        self._outdated[simulation] = ~may_touch
        self.moving = [self._worlds[number] for number in numbers.tolist()]
        return rows[~may_touch], rows[may_touch]

    def _world(self, simulation: int) -> BulletWorld:
        if simulation not in self._worlds:
            self._worlds[simulation] = BulletWorld(self._fleet.bodies, self._fleet.dt)
        return self._worlds[simulation]
