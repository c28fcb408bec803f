"""Bullet's worlds of all simulations, each asked only in steps in which somebody may touch somebody."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Floats, Longs
from smarts.dynamics.bullet import Box, BulletWorld
from smarts.dynamics.free_motion import find_company
from smarts.geometry.binding import bind

Rows = Longs


class BulletWorlds:
    """The bodies of a fleet, in one world for each simulation.

    A world that is not asked in a step is outdated from then on: others move its bodies. Before it is asked
    again, they are put where they have come to.

    Args:
        cars: Parameters of the fleet's vehicles, shape (E,), dtype `layout.PARAMETERS`.
        bodies: Their motion, shape (E, 13); see `BulletWorld`.
        simulations: B.
        step: [s].
        dt: Sub-step [s].
    """

    def __init__(
        self, cars: NDArray[np.void], bodies: Floats, simulations: int, step: float, dt: float
    ) -> None:
        self._cars, self._egos = cars, len(cars) // simulations
        self._worlds = [BulletWorld(bodies, dt) for _ in range(simulations)]
        self.moving: Sequence[BulletWorld] = ()
        """The worlds that are to advance in this step; their vehicles may touch something."""
        self._with_boxes = np.zeros(simulations, np.bool_)
        self._company = np.zeros(simulations, np.bool_)
        self._outdated = np.zeros(simulations, np.bool_)
        self._find_company = bind(find_company, cars, bodies, self._with_boxes, step, self._company)

    def close(self) -> None:
        """Free the worlds."""
        for world in self._worlds:
            world.close()

    def clear(self, simulation: int) -> None:
        """Take everything out of a simulation and forget its past."""
        self._worlds[simulation].clear()
        self._with_boxes[simulation] = self._outdated[simulation] = False

    def add(self, row: int) -> None:
        """Let a vehicle in; see `BulletWorld.add`."""
        self._worlds[row // self._egos].add(row, self._cars[row])

    def remove(self, row: int) -> None:
        """Take a vehicle out."""
        self._worlds[row // self._egos].remove(row)

    def place_boxes(self, simulation: int, boxes: Mapping[int, Box]) -> None:
        """Say which boxes there are in a simulation from now on; see `BulletWorld.place_boxes`."""
        self._worlds[simulation].place_boxes(boxes)
        self._with_boxes[simulation] = bool(boxes)

    def part(self, rows: Rows) -> tuple[Rows, Rows]:
        """Return which vehicles touch nothing in the step that begins, and which may.

        The worlds of these are up to date then, and are in `moving`.

        Args:
            rows: Vehicles in Bullet that are to move, in ascending order, shape (R,).
        """
        simulation = rows // self._egos
        if not self._find_company(rows):
            self._outdated[simulation] = True
            self.moving = ()
            return rows, rows[:0]
        may_touch = self._company[simulation]
        numbers = np.unique(simulation[may_touch])
        for number in numbers[self._outdated[numbers]].tolist():
            self._worlds[number].put()
        self._outdated[simulation] = ~may_touch
        self.moving = [self._worlds[number] for number in numbers.tolist()]
        return rows[~may_touch], rows[may_touch]
