"""Corridors: a route as all the lanes that follow it, junction lanes included, and one distance along it."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from smarts.arrays import Bools, Bytes, Floats, Ints
from smarts.errors import MapError
from smarts.roads.lane_graph import LaneGraph, LaneKind
from smarts.roads.memory import remembered
from smarts.roads.routes import CARS, edge_graph, names_of

Counts = Bytes

FAR = 100
"""Stands for the number of lane changes where none lead on."""


@dataclass(frozen=True, eq=False)
class Corridor:
    """The lanes of a route, one row for each time that the route uses a lane.

    Distance along the route is measured on reference lengths, the same for all lanes side by side: a road
    edge counts with its shortest usable lane, a junction with its shortest usable way to the next edge. So
    two vehicles that are level with each other on different lanes have gone equally far.
    """

    lane: Ints
    """Shape (R,); rows are ordered by group, then by lane."""
    group: Ints
    """Rows of one group lie side by side: 2k for the lanes of the route's k-th edge, 2k + 1 for the junction
    after it, shape (R,)."""
    begin: Floats
    """Distance along the route where the lane begins [m]; NaN in a corridor without a route, shape (R,)."""
    end: Floats
    """Distance along the route where the lane ends [m], shape (R,)."""
    onward_start: Ints
    """CSR of the rows that a row leads into without leaving the route, shape (R + 1,)."""
    onward: Ints

    @cached_property
    def by_lane(self) -> Ints:
        """Rows in ascending order of lane, and along the route where lanes are equal."""
        return np.argsort(self.lane, kind="stable").astype(np.int32)

    @cached_property
    def before(self) -> Ints:
        """Row of the lane before within the same group, -1 where none is: the ways through a junction."""
        source = np.repeat(np.arange(len(self.lane), dtype=np.int32), np.diff(self.onward_start))
        same = self.group[source] == self.group[self.onward]
        before = np.full(len(self.lane), -1, np.int32)
        before[self.onward[same]] = source[same]
        return before

    @cached_property
    def changes(self) -> Counts:
        """Fewest lane changes from each row to each lane of the last edge, shape (R, K).

        Column k stands for the k-th row from the end. Positive where the first of the changes is to the left,
        negative to the right; `FAR` where no way leads there. All 0 in a corridor without a route.
        """
        count = len(self.lane)
        if not count or np.isnan(self.end).any():
            return np.zeros((count, 1), np.int8)
        last = np.flatnonzero(self.group == self.group[-1])
        needed = np.full((count, len(last)), FAR, np.int8)
        needed[last[::-1], np.arange(len(last))] = 0
        for group in range(int(self.group[-1]), -1, -1):
            rows = np.flatnonzero(self.group == group)
            # Within a junction a way may lead through several rows: as often as there are rows.
            for _ in range(len(rows) if group % 2 else 1):
                for row in rows:
                    for following in self.onward[self.onward_start[row] : self.onward_start[row + 1]]:
                        needed[row] = _nearer(needed[row], needed[following])
            if group % 2 == 0:
                needed[rows] = _from_aside(needed[rows])
        return needed

    @property
    def length(self) -> float:
        """Distance from the begin of the first edge to the end of the last [m]; NaN without a route."""
        return float(self.end[-1]) if len(self.end) else 0.0


@dataclass
class _Row:
    lane: int
    group: int
    begin: float
    end: float
    onward: list[int]
    """Lanes of the rows that follow."""


def _nearer(one: Counts, other: Counts) -> Counts:
    return np.where(np.abs(other) < np.abs(one), other, one)


def _from_aside(ahead: Counts) -> Counts:
    """Return the changes that lanes side by side, rightmost first, demand, given those ahead of each."""
    needed = ahead.copy()
    for own in range(len(ahead)):
        for other in range(len(ahead)):
            aside = other - own
            by_other = np.minimum(np.abs(ahead[other]) + abs(aside), FAR) * np.sign(aside)
            needed[own] = _nearer(needed[own], by_other.astype(np.int8)) if aside else needed[own]
    return needed


@remembered(most=1024)
def route_corridor(graph: LaneGraph, route: tuple[str, ...], kinds: frozenset[LaneKind] = CARS) -> Corridor:
    """Return the (remembered) corridor of a route.

    Args:
        graph: The map.
        route: Ids of road edges, each leading into the next.
        kinds: The lanes that belong to it.

    Raises:
        MapError: An edge does not exist, has no lane of these kinds, or does not lead into the one after it.
    """
    edges = edge_graph(graph, kinds, "length")
    numbers = [graph.edge_number(name) for name in route]
    usable = np.isin(graph.kind, list(kinds))
    rows: list[_Row] = []
    station = 0.0
    for leg, (edge, following) in enumerate(zip(numbers, [*numbers[1:], None], strict=True)):
        if not np.isfinite(edges.cost[edge]):
            problem = f"edge '{route[leg]}' has no lane of kind {names_of(kinds)}"
            raise MapError(problem, remedy="choose an edge that is open to the route's vehicles")
        between = 0.0 if following is None else edges.onward[edge].get(following)
        if between is None:
            problem = f"edge '{route[leg]}' does not lead into edge '{route[leg + 1]}'"
            raise MapError(problem, remedy="complete the route with the edges in between")
        end = station + edges.cost[edge]
        lanes = [lane for lane in graph.edge_lanes(edge) if usable[lane]]
        chains = [] if following is None else _chains(graph, lanes, following, usable)
        rows += [_Row(lane, 2 * leg, station, end, [c[1] for c in chains if c[0] == lane]) for lane in lanes]
        rows += sorted(_junction_rows(graph, chains, 2 * leg + 1, end, between), key=lambda row: row.lane)
        station = end + between
    return _corridor(rows)


@remembered(most=8)
def free_corridor(graph: LaneGraph, kinds: frozenset[LaneKind]) -> Corridor:
    """Return the corridor of going anywhere: row i is lane i, and every usable exit of a junction is open.

    Lanes side by side are those of one edge; inside junctions, of one connection of two edges.
    """
    lanes = np.arange(len(graph.lane_ids), dtype=np.int32)
    usable = np.isin(graph.kind, list(kinds))
    kept = usable[graph.successor]
    # How many of the links before each lane's own are kept.
    start = np.concatenate(([0], np.cumsum(kept)))[graph.successor_start].astype(np.int32)
    unknown = np.full(len(lanes), np.nan)
    return Corridor(lanes, graph.lane_edge, unknown, unknown, start, graph.successor[kept])


def _chains(graph: LaneGraph, lanes: Sequence[int], edge: int, usable: Bools) -> list[list[int]]:
    """Return the ways from the given lanes through the junction to an edge: lanes, both ends included."""
    chains: list[list[int]] = []
    open_chains = [[lane] for lane in reversed(lanes)]
    while open_chains:
        chain = open_chains.pop()
        for successor in graph.successors(chain[-1])[::-1]:
            if not usable[successor]:
                continue
            if graph.is_internal[successor]:
                open_chains.append([*chain, int(successor)])
            elif graph.lane_edge[successor] == edge:
                chains.append([*chain, int(successor)])
    return chains


def _junction_rows(
    graph: LaneGraph, chains: Sequence[Sequence[int]], group: int, begin: float, span: float
) -> list[_Row]:
    rows: dict[int, _Row] = {}
    for chain in chains:
        inside = chain[1:-1]
        stations = np.concatenate(([0.0], np.cumsum(graph.length[list(inside)])))
        stations = begin + stations * (span / max(stations[-1], 1e-9))
        for place, (lane, following) in enumerate(itertools.pairwise(chain[1:])):
            row = rows.setdefault(lane, _Row(lane, group, stations[place], stations[place + 1], []))
            if following not in row.onward:
                row.onward.append(following)
    return list(rows.values())


def _corridor(rows: Sequence[_Row]) -> Corridor:
    numbers = {(row.lane, row.group): number for number, row in enumerate(rows)}

    def numbers_onward(row: _Row) -> list[int]:
        # A lane's successor is in the same junction, or else in the group after.
        places = {(lane, (row.group | 1) + ahead) for lane in row.onward for ahead in (0, 1)}
        return sorted(numbers[place] for place in places & numbers.keys())

    onward = [*map(numbers_onward, rows)]
    return Corridor(
        lane=np.array([row.lane for row in rows], np.int32),
        group=np.array([row.group for row in rows], np.int32),
        begin=np.array([row.begin for row in rows], np.float64),
        end=np.array([row.end for row in rows], np.float64),
        onward_start=np.cumsum([0, *(len(numbers) for numbers in onward)]).astype(np.int32),
        onward=np.array([number for numbers in onward for number in numbers], np.int32),
    )
