"""Planned routes by number, so that a vehicle's row can name the way that it is going to take."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from smarts.arrays import Ints


class PlannedRoutes:
    """The routes that vehicles of B simulations have planned.

    Numbers are consecutive, hold for the episode, and are only added: readers need to look at new ones only.

    Args:
        worlds: B.
    """

    def __init__(self, worlds: int) -> None:
        self._numbers: list[dict[tuple[int, ...], int]] = [{} for _ in range(worlds)]
        self._routes: list[list[Ints]] = [[] for _ in range(worlds)]

    def number(self, row: int, edges: Iterable[int]) -> int:
        """Return the number of a route, a new one if no vehicle has planned it so far.

        Args:
            row: The simulation.
            edges: Road edges by their number in the simulation's map, the vehicle's own first; an empty route
                has number -1.
        """
        route = tuple(edges)
        if not route:
            return -1
        numbers = self._numbers[row]
        if route not in numbers:
            numbers[route] = len(numbers)
            array = np.array(route, np.int32)
            array.flags.writeable = False
            self._routes[row].append(array)
        return numbers[route]

    def edges(self, row: int, number: int) -> Ints:
        """Return the edges of a route by their numbers, shape (E,), read-only."""
        return self._routes[row][number]

    def count(self, row: int) -> int:
        """Return how many routes a simulation has."""
        return len(self._routes[row])

    def reset(self, row: int) -> None:
        """Forget the routes of a simulation."""
        self._numbers[row].clear()
        self._routes[row].clear()
