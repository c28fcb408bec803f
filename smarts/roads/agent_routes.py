"""The routes of all agents in one table, so that one call serves the agents of many simulations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from smarts.arrays import Ints
from smarts.geometry.binding import Replaceable
from smarts.roads.atlas import RoadAtlas
from smarts.roads.kernels import RouteTable


class AgentRoutes:
    """The route of `table` that each agent follows.

    Args:
        atlas: The maps.
        worlds: B, the number of simulations.
        agents: A, the agents of each.
    """

    def __init__(self, atlas: RoadAtlas, worlds: int, agents: int) -> None:
        self.number: Ints = np.full((worlds, agents), -1, np.int32)
        """Route number in `table`, -1 without a route, shape (B, A); written in place."""
        self.current = Replaceable(atlas.no_routes._replace(number=self.number))
        """`table`, for kernels to be bound to."""
        self.atlas = atlas
        self._maps = [0] * worlds
        self._routes: list[list[tuple[str, ...]]] = [[()] * agents for _ in range(worlds)]

    @property
    def table(self) -> RouteTable:
        """The routes; replaced at every assignment: pass it on as it is, do not keep it."""
        return self.current.value

    def assign(self, row: int, map_number: int, routes: Sequence[tuple[str, ...]]) -> None:
        """Give the first agents of one simulation their routes, ids of road edges, and the others none.

        Raises:
            MapError: A route has an unknown edge or a gap.
        """
        agents = self.number.shape[1]
        self._maps[row] = map_number
        self._routes[row] = [*map(tuple, routes), *[()] * (agents - len(routes))]
        self._tabulate()

    def assign_agent(self, row: int, agent_id: int, route: Sequence[str]) -> None:
        """Give one agent of a simulation another route, or an empty one.

        Raises:
            MapError: The route has an unknown edge or a gap.
        """
        before, self._routes[row][agent_id] = self._routes[row][agent_id], tuple(route)
        if not route:
            # The table keeps the old route until the next one is written: that takes milliseconds.
            self.number[row, agent_id] = -1
        elif before != tuple(route):
            self._tabulate()

    def route(self, row: int, agent_id: int) -> tuple[str, ...]:
        """Return the ids of the road edges of an agent's route."""
        return self._routes[row][agent_id]

    def _tabulate(self) -> None:
        """Rebuild the table; equal routes on one map share their rows."""
        places: dict[tuple[int, tuple[str, ...]], int] = {}
        for row, routes in enumerate(self._routes):
            for agent_id, route in enumerate(routes):
                key = (self._maps[row], route)
                self.number[row, agent_id] = places.setdefault(key, len(places)) if route else -1
        self.current.replace(self.atlas.route_table(places)._replace(number=self.number))
