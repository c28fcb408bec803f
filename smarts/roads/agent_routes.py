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

    The table is written from the routes that agents have, at resets and whenever an agent gets a route that
    is not in it. Route numbers may change whenever the table is written: do not keep them.

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
        self._places: dict[tuple[int, tuple[str, ...]], int] = {}
        """Number of each route of the table, by its map and its edges."""

    @property
    def table(self) -> RouteTable:
        """The routes; may be replaced at every assignment: pass it on as it is, do not keep it."""
        return self.current.value

    def assign(self, row: int, map_number: int, routes: Sequence[tuple[str, ...]]) -> None:
        """Give the first agents of one simulation their routes, ids of road edges, and the others none.

        Raises:
            MapError: A route has an unknown edge or a gap.
        """
        given = [*map(tuple, routes), *[()] * (self.number.shape[1] - len(routes))]
        if (map_number, given) == (self._maps[row], self._routes[row]):
            return
        self._maps[row], self._routes[row] = map_number, given
        self._tabulate()

    def assign_agent(self, row: int, agent_id: int, route: Sequence[str]) -> None:
        """Give one agent of a simulation another route, or an empty one.

        Raises:
            MapError: The route has an unknown edge or a gap.
        """
        self._routes[row][agent_id] = tuple(route)
        key = self._maps[row], tuple(route)
        if route and key not in self._places:
            self._tabulate()
        self.number[row, agent_id] = self._places[key] if route else -1

    def route(self, row: int, agent_id: int) -> tuple[str, ...]:
        """Return the ids of the road edges of an agent's route."""
        return self._routes[row][agent_id]

    def _tabulate(self) -> None:
        """Write the table again; equal routes on one map share their rows."""
        places: dict[tuple[int, tuple[str, ...]], int] = {}
        for row, routes in enumerate(self._routes):
            for agent_id, route in enumerate(routes):
                key = (self._maps[row], route)
                self.number[row, agent_id] = places.setdefault(key, len(places)) if route else -1
        self.current.replace(self.atlas.route_table(places)._replace(number=self.number))
        self._places = places
