"""The routes of all agents in one table, so that one call serves the agents of many simulations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from smarts.roads.atlas import RoadAtlas
from smarts.roads.kernels import RouteTable

Ints = NDArray[np.int32]


class SeatRoutes:
    """Which route of `table` each seat's agent follows.

    Args:
        atlas: The maps.
        worlds: B, the number of simulations.
        seats: A, the seats of each.
    """

    def __init__(self, atlas: RoadAtlas, worlds: int, seats: int) -> None:
        self.number: Ints = np.full((worlds, seats), -1, np.int32)
        """Route number in `table`, -1 without a route, shape (B, A); written in place."""
        self.table: RouteTable = atlas.no_routes
        """Replaced at every `assign`; pass it on as it is, do not keep it."""
        self._atlas = atlas
        self._routes: list[list[tuple[int, tuple[str, ...]]]] = [[] for _ in range(worlds)]

    def assign(self, row: int, map_number: int, routes: Sequence[tuple[str, ...]]) -> None:
        """Give the first seats of one simulation their routes, ids of road edges, and the others none.

        Raises:
            MapError: A route has an unknown edge or a gap.
        """
        self._routes[row] = [(map_number, tuple(route)) for route in routes]
        self.number[:] = -1
        driven = []
        for world, seats in enumerate(self._routes):
            for seat, (number, route) in enumerate(seats):
                if route:
                    self.number[world, seat] = len(driven)
                    driven.append((number, route))
        self.table = self._atlas.route_table(driven)
