"""Corridors: a route as all the lanes that follow it, junction lanes included, and one distance along it."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from smarts.arrays import Bools, Bytes, Floats, Ints
from smarts.errors import MapError
from smarts.geometry.compiling import kernel
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
    kind: Bytes
    """A `LaneKind`, shape (R,)."""

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
        negative to the right; `FAR` where no way leads there. All 0 in a corridor without a route. From lanes
        for cars, changes lead into bus lanes only where no others lead there.
        """
        count = len(self.lane)
        if not count or np.isnan(self.end).any():
            return np.zeros((count, 1), np.int8)
        needed = np.empty((count, np.count_nonzero(self.group == self.group[-1])), np.int8)
        is_for_cars = self.kind == LaneKind.CAR
        count_changes(self.group, self.onward_start, self.onward, is_for_cars, needed, FAR)
        return needed

    @property
    def length(self) -> float:
        """Distance from the begin of the first edge to the end of the last [m]; NaN without a route."""
        return float(self.end[-1]) if len(self.end) else 0.0


class _Leg(NamedTuple):
    """The rows of one edge of a route, and of the junction behind it."""

    lane: Ints
    """Lanes of the edge first, then of the junction, each in their order in the map, shape (R,)."""
    edges: int
    """How many of them are of the edge."""
    begin: Floats
    """Distance from the end of the edge to the begin of the junction's rows [m]; 0 of others, shape (R,)."""
    end: Floats
    """Distance from the end of the edge to their end [m], shape (R,)."""
    onward_count: Ints
    """How many rows follow each row, shape (R,)."""
    onward: Ints
    """The rows that follow, counted from the leg's first; behind the leg's own come the next edge's."""
    length: float
    """Length of the edge [m]."""
    between: float
    """Length of the way through the junction [m]."""


@kernel
def count_changes(
    group: Ints, onward_start: Ints, onward: Ints, is_for_cars: Bools, needed: Counts, far: int
) -> None:
    """Write `Corridor.changes` of a route.

    Args:
        group: See `Corridor`, shape (R,).
        onward_start: See `Corridor`, shape (R + 1,).
        onward: See `Corridor`.
        is_for_cars: Which rows are lanes for cars, shape (R,).
        needed: Written, shape (R, K).
        far: Stands for the number of lane changes where none lead on.
    """
    rows, lasts = needed.shape
    needed[:] = far
    for column in range(lasts):
        needed[rows - 1 - column, column] = 0
    end = rows
    while end > 0:
        begin = end - 1
        while begin > 0 and group[begin - 1] == group[end - 1]:
            begin -= 1
        # Within a junction a way may lead through several rows: as often as there are rows.
        for _ in range(end - begin if group[begin] % 2 else 1):
            _look_onward(begin, end, onward_start, onward, needed)
        if group[begin] % 2 == 0:
            _look_aside(begin, end, is_for_cars, needed, far)
        end = begin


@kernel
def _look_onward(begin: int, end: int, onward_start: Ints, onward: Ints, needed: Counts) -> None:
    """Write the changes that the rows behind those of a group demand, if they are fewer."""
    for row in range(begin, end):
        for place in range(onward_start[row], onward_start[row + 1]):
            for column in range(needed.shape[1]):
                count = needed[onward[place], column]
                if abs(count) < abs(needed[row, column]):
                    needed[row, column] = count


@kernel
def _look_aside(begin: int, end: int, is_for_cars: Bools, needed: Counts, far: int) -> None:
    """Write the changes of lanes side by side, rightmost first, if changing to another demands fewer."""
    ahead = np.abs(needed[begin:end].astype(np.int64))
    for row in range(begin, end):
        for column in range(needed.shape[1]):
            _change_aside(begin, end, row, column, is_for_cars, ahead, needed, far)
            if is_for_cars[row] and abs(needed[row, column]) == far:
                # Buses may change into bus lanes.
                _change_aside(begin, end, row, column, np.zeros_like(is_for_cars), ahead, needed, far)


@kernel
def _change_aside(
    begin: int, end: int, row: int, column: int, is_for_cars: Bools, ahead: Ints, needed: Counts, far: int
) -> None:
    """Write the changes of one lane to one lane of the last edge; see `_look_aside`."""
    for other in range(begin, end):
        count = min(ahead[other - begin, column] + abs(other - row), far)
        is_open = is_for_cars[other] or not is_for_cars[row]
        if other != row and is_open and count < abs(needed[row, column]):
            needed[row, column] = count if other > row else -count


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
    numbers = [graph.edge_number(name) for name in route]
    legs = [_leg(graph, kinds, *pair) for pair in zip(numbers, [*numbers[1:], -1], strict=True)]
    begins, ends, counts, firsts = [], [], [], []
    station, first = 0.0, 0
    for leg in legs:
        end = station + leg.length
        begins += [station, end]
        ends += [end, end]
        counts += [leg.edges, len(leg.lane) - leg.edges]
        firsts.append(first)
        station, first = end + leg.between, first + len(leg.lane)
    onward = np.concatenate([leg.onward for leg in legs])
    lane = np.concatenate([leg.lane for leg in legs])
    return Corridor(
        lane=lane,
        group=np.repeat(np.arange(len(counts), dtype=np.int32), counts),
        begin=np.repeat(begins, counts) + np.concatenate([leg.begin for leg in legs]),
        end=np.repeat(ends, counts) + np.concatenate([leg.end for leg in legs]),
        onward_start=_offsets(np.concatenate([leg.onward_count for leg in legs])),
        onward=onward + np.repeat(np.array(firsts, np.int32), [len(leg.onward) for leg in legs]),
        kind=graph.kind[lane],
    )


@remembered(most=4096)
def _leg(graph: LaneGraph, kinds: frozenset[LaneKind], edge: int, following: int) -> _Leg:
    """Return the rows of an edge, and of the junction between it and the edge that follows, -1 for none."""
    usable = _usable(graph, kinds)
    length, between = _lengths(graph, kinds, edge, following)
    lanes = [lane for lane in graph.edge_lanes(edge) if usable[lane]]
    ways = [[lane, *way] for lane in lanes for way in graph.ways_from(lane, usable)]
    chains = [way for way in ways if graph.lane_edge[way[-1]] == following]
    inside = _junction_rows(graph, chains, between)
    rows = [*lanes, *sorted(inside)]
    ahead = [] if following < 0 else [lane for lane in graph.edge_lanes(following) if usable[lane]]
    numbers = {lane: number for number, lane in enumerate([*rows, *ahead])}
    # A lane of the edge leads into what is behind it, also if the edge follows itself.
    numbers |= {lane: len(rows) + number for number, lane in enumerate(ahead)}
    onward = [{chain[1] for chain in chains if chain[0] == lane} for lane in lanes]
    onward += [inside[lane].onward for lane in rows[len(lanes) :]]
    following_rows = [sorted(numbers[lane] for lane in each) for each in onward]
    return _Leg(
        lane=np.array(rows, np.int32),
        edges=len(lanes),
        begin=np.array([0.0] * len(lanes) + [inside[lane].begin for lane in rows[len(lanes) :]]),
        end=np.array([0.0] * len(lanes) + [inside[lane].end for lane in rows[len(lanes) :]]),
        onward_count=np.array([len(each) for each in following_rows], np.int32),
        onward=np.array([*itertools.chain(*following_rows)], np.int32),
        length=length,
        between=between,
    )


def _lengths(graph: LaneGraph, kinds: frozenset[LaneKind], edge: int, following: int) -> tuple[float, float]:
    """Return the lengths of an edge, and of the junction behind it; raise if the route is not open."""
    edges = edge_graph(graph, kinds, "length")
    if not np.isfinite(edges.cost[edge]):
        problem = f"edge '{graph.edge_ids[edge]}' has no lane of kind {names_of(kinds)}"
        raise MapError(problem, remedy="choose an edge that is open to the route's vehicles")
    between = 0.0 if following < 0 else edges.onward[edge].get(following)
    if between is None:
        problem = f"edge '{graph.edge_ids[edge]}' does not lead into edge '{graph.edge_ids[following]}'"
        raise MapError(problem, remedy="complete the route with the edges in between")
    return edges.cost[edge], between


@remembered(most=8)
def _usable(graph: LaneGraph, kinds: frozenset[LaneKind]) -> Bools:
    return np.isin(graph.kind, list(kinds))


def _offsets(counts: Ints) -> Ints:
    offsets = np.zeros(len(counts) + 1, np.int32)
    np.cumsum(counts, out=offsets[1:])
    return offsets


@remembered(most=8)
def free_corridor(graph: LaneGraph, kinds: frozenset[LaneKind]) -> Corridor:
    """Return the corridor of going anywhere: row i is lane i, and every usable exit of a junction is open.

    Lanes side by side are those of one edge; inside junctions, of one connection of two edges.
    """
    lanes = np.arange(len(graph.lane_ids), dtype=np.int32)
    kept = np.isin(graph.kind, list(kinds))[graph.successor]
    # How many of the links before each lane's own are kept.
    start = np.concatenate(([0], np.cumsum(kept)))[graph.successor_start].astype(np.int32)
    unknown = np.full(len(lanes), np.nan)
    return Corridor(lanes, graph.lane_edge, unknown, unknown, start, graph.successor[kept], graph.kind)


class _Inside(NamedTuple):
    """A lane inside a junction."""

    begin: float
    """Distance from the junction's begin, on its shortest way [m]."""
    end: float
    onward: set[int]
    """Lanes that follow."""


def _junction_rows(graph: LaneGraph, chains: Sequence[Sequence[int]], span: float) -> dict[int, _Inside]:
    """Return the lanes inside a junction that some ways through it use.

    Args:
        graph: The map.
        chains: The ways: lanes, those before and after the junction included.
        span: Length that every way counts with [m].
    """
    rows: dict[int, _Inside] = {}
    for chain in chains:
        stations = np.concatenate(([0.0], np.cumsum(graph.length[list(chain[1:-1])])))
        stations = stations * (span / max(stations[-1], 1e-9))
        for place, (lane, following) in enumerate(itertools.pairwise(chain[1:])):
            row = rows.setdefault(lane, _Inside(stations[place], stations[place + 1], set()))
            row.onward.add(following)
    return rows
