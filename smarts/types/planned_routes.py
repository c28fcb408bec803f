"""Planned routes by number, so that a vehicle's row can name the way that it is going to take."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from smarts.arrays import Ints
from smarts.geometry.binding import Replaceable


class RouteEdges(NamedTuple):
    """The edges of R routes of each simulation; those of route r from `first[b, r]` to `first[b, r + 1]`."""

    first: Ints
    """Shape (B, R + 1)."""
    edge: Ints
    """Road edges by their number in the simulation's map, shape (B, E)."""


class PlannedRoutes:
    """The routes that vehicles of B simulations have planned.

    Numbers are consecutive, hold for the episode, and are only added: readers need to look at new ones only.

    Args:
        worlds: B.
    """

    def __init__(self, worlds: int) -> None:
        self._numbers: list[dict[tuple[int, ...], int]] = [{} for _ in range(worlds)]
        arrays = np.zeros((worlds, 9), np.int32), np.zeros((worlds, 64), np.int32)
        self.table = Replaceable(RouteEdges(*arrays))
        """For kernels; replaced when it grows."""

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
            number = numbers[route] = len(numbers)
            begin = int(self.table.value.first[row, number])
            end = begin + len(route)
            while number + 1 >= self.table.value.first.shape[1] or end > self.table.value.edge.shape[1]:
                grown = (np.pad(each, ((0, 0), (0, each.shape[1]))) for each in self.table.value)
                self.table.replace(RouteEdges(*grown))
            self.table.value.first[row, number + 1] = end
            self.table.value.edge[row, begin:end] = route
        return numbers[route]

    def edges(self, row: int, number: int) -> Ints:
        """Return the edges of a route by their numbers, shape (E,)."""
        first, edge = self.table.value
        return edge[row, first[row, number] : first[row, number + 1]].copy()

    def count(self, row: int) -> int:
        """Return how many routes a simulation has."""
        return len(self._numbers[row])

    def reset(self, row: int) -> None:
        """Forget the routes of a simulation."""
        self._numbers[row].clear()
