"""The routes of all agents in one table, so that one call serves the agents of many simulations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Ints
from smarts.geometry.binding import Replaceable
from smarts.roads.atlas import ROAD_LANES, RoadAtlas
from smarts.roads.corridors import Corridor, route_corridor
from smarts.roads.kernels import RouteTable

SPARE = 4096
"""Rows that a table gets beyond its routes when one is added in mid-episode."""
_ROWS = ("lane", "group", "begin", "end", "before", "by_lane", "changes")
"""Columns of a table with an entry, or a row, for each of its rows."""


class AgentRoutes:
    """The route of `table` that each agent follows.

    The resets of simulations write the table from the routes that agents have. In mid-episode a route is
    appended to it, which takes microseconds; where no room is left, the table is written again, with room.
    Route numbers may change whenever the table is written: do not keep them.

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
        self._spare = 0
        """Rows of the table that belong to no route: 0 until a route is added in mid-episode."""
        self._rows = self._onward = self._groups = 0
        """How many rows, onward rows and groups of the table are in use."""

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
        if not self._spare and (map_number, given) == (self._maps[row], self._routes[row]):
            return
        self._maps[row], self._routes[row] = map_number, given
        self._tabulate()

    def assign_agent(self, row: int, agent_id: int, route: Sequence[str]) -> None:
        """Give one agent of a simulation another route, or an empty one.

        Raises:
            MapError: The route has an unknown edge or a gap.
        """
        self._routes[row][agent_id] = tuple(route)
        if not route:
            self.number[row, agent_id] = -1
            return
        key = self._maps[row], tuple(route)
        if key not in self._places:
            corridor = route_corridor(self.atlas.graphs[key[0]], key[1], ROAD_LANES)
            if not self._has_room(corridor):
                self._spare = SPARE + len(corridor.lane)
                self._tabulate()
                return
            self._append(key, corridor)
        self.number[row, agent_id] = self._places[key]

    def route(self, row: int, agent_id: int) -> tuple[str, ...]:
        """Return the ids of the road edges of an agent's route."""
        return self._routes[row][agent_id]

    def _tabulate(self) -> None:
        """Write the table again, with its spare rows; equal routes on one map share their rows."""
        places: dict[tuple[int, tuple[str, ...]], int] = {}
        for row, routes in enumerate(self._routes):
            for agent_id, route in enumerate(routes):
                key = (self._maps[row], route)
                self.number[row, agent_id] = places.setdefault(key, len(places)) if route else -1
        table = self.atlas.route_table(places)._replace(number=self.number)
        self._places = places
        self._rows, self._onward = len(table.lane), len(table.onward)
        self._groups = int(table.group.max(initial=-1)) + 1
        self.current.replace(self._with_room(table, self._spare) if self._spare else table)

    def _with_room(self, table: RouteTable, spare: int) -> RouteTable:
        """Return a table with more rows, which belong to no route yet."""
        missing = int(self.atlas.roads.lane_index.max(initial=0)) + 1 - table.changes.shape[1]
        table = table._replace(changes=np.pad(table.changes, ((0, 0), (0, max(missing, 0)))))
        # No lane of these maps leads into more than a few others.
        longer = {name: _longer(getattr(table, name), spare) for name in (*_ROWS, "start", "onward_start")}
        return table._replace(**longer, onward=_longer(table.onward, 4 * spare))

    def _has_room(self, corridor: Corridor) -> bool:
        """Return whether a corridor fits behind those of the table."""
        table, number = self.table, len(self._places)
        return (
            self._rows + len(corridor.lane) <= len(table.lane)
            and self._onward + len(corridor.onward) <= len(table.onward)
            and table.free + number + 1 < len(table.start)
            and corridor.changes.shape[1] <= table.changes.shape[1]
        )

    def _append(self, key: tuple[int, tuple[str, ...]], corridor: Corridor) -> None:
        """Write a route behind those of the table."""
        table, first, number = self.table, self._rows, len(self._places)
        rows = slice(first, first + len(corridor.lane))
        table.lane[rows] = corridor.lane + self.atlas.roads.lane_base[key[0]]
        table.group[rows] = corridor.group + self._groups
        table.begin[rows], table.end[rows] = corridor.begin, corridor.end
        table.before[rows] = np.where(corridor.before < 0, -1, corridor.before + first)
        table.by_lane[rows] = corridor.by_lane + first
        table.changes[rows] = 0
        table.changes[rows, : corridor.changes.shape[1]] = corridor.changes
        table.onward_start[first + 1 : rows.stop + 1] = corridor.onward_start[1:] + self._onward
        table.onward[self._onward : self._onward + len(corridor.onward)] = corridor.onward + first
        table.start[table.free + number + 1] = rows.stop
        self._rows, self._onward = rows.stop, self._onward + len(corridor.onward)
        self._groups += int(corridor.group.max(initial=-1)) + 1
        self._places[key] = number


def _longer(column: NDArray, spare: int) -> NDArray:
    """Return a column with more entries, -1 each."""
    return np.concatenate([column, np.full((spare, *column.shape[1:]), -1, column.dtype)])
