"""Routes as rows of lanes: where a lane leads to, and how far without a lane change."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from smarts.roads.lane_graph import LaneGraph

FARTHEST = 3000.0
"""Lanes that lead farther are equally good [m], as for SUMO's drivers."""
SAME = 1.0
"""Lanes that lead equally far, to so much, are equally good [m]."""
ARRIVES = 1e5
"""Added to how far the lane leads on which a route ends [m]."""
Stop = tuple[int, int, float, float, float]
"""Number of an edge on the route, index of a lane, begin and end of the place there [m], duration [s]."""


@dataclass
class Row:
    """A use of a lane by a route, see `state.Way`."""

    lane: int
    length: float
    next: int = -1
    left: int = -1
    right: int = -1
    changes: int = 0
    arrival: float = np.inf
    stop: tuple[float, float, float] = (np.inf, np.inf, 0.0)
    """Where it stops, from and to [m], and for how long [s]; `next` is then the same lane after the stop."""
    chains: list[list[int]] = field(default_factory=list)
    """Ways through the junction ahead to lanes of the route's next edge."""
    chosen: list[int] = field(default_factory=list)
    """The one that the vehicle takes."""


def route_rows(
    graph: LaneGraph,
    edges: Sequence[int],
    arrival: tuple[int, float],
    stops: Iterable[Stop] = (),
    *,
    repeats: bool,
) -> list[Row]:
    """Return a route's rows; first those of the first edge's lanes, from the right.

    Args:
        graph: The map; lanes are numbered within it.
        edges: The route's.
        arrival: Index of the lane on which the route ends, -1 for any, and the arc length there [m].
        stops: Where it stops.
        repeats: Whether the route goes round: its last edge leads to its first.
    """
    uses, stop_at, onward = _uses(edges, stops)
    rows = [Row(lane, float(graph.length[lane])) for edge in uses for lane in graph.edge_lanes(edge)]
    first = np.cumsum([0, *(len(graph.edge_lanes(edge)) for edge in uses)]).tolist()
    groups = [rows[begin:end] for begin, end in pairwise(first)]
    for group, following in zip(groups, onward, strict=True):
        for row in group:
            ways = graph.ways_from(row.lane)
            row.chains = [way for way in ways if graph.lane_edge[way[-1]] == uses[following]]
    if not repeats:
        _end(groups[-1], arrival)
    # The choice on a circuit's last edges depends on its first ones.
    for k in [*range(len(uses) - 1, -1, -1)] * (2 if repeats else 1):
        for row in groups[k]:
            if row.chains:
                _choose_chain(graph, row, rows, first[onward[k]], uses[onward[k]])
        if k in stop_at:
            _add_stop(groups[k], rows, first[k + 1], stop_at[k])
        _set_beside(groups[k], first[k])
    _add_inside(graph, rows)
    return rows


def _set_beside(group: Sequence[Row], first: int) -> None:
    """Set the rows beside each of an edge, from the row `first` on, and the lane changes to a best one."""
    best = max(min(row.length, FARTHEST) for row in group)
    good = [index for index, row in enumerate(group) if row.length >= best - SAME]
    for index, row in enumerate(group):
        row.changes = min((other - index for other in good), key=abs)
        row.right = first + index - 1 if index else -1
        row.left = first + index + 1 if index + 1 < len(group) else -1


def _uses(edges: Sequence[int], stops: Iterable[Stop]) -> tuple[list[int], dict[int, Stop], list[int]]:
    """Return the edges, twice where there is a stop: until it and after it; stops by use; following uses."""
    uses, stop_at = [], {}
    for number, edge in enumerate(edges):
        own = [stop for stop in stops if stop[0] == number]
        stop_at |= {len(uses) + count: stop for count, stop in enumerate(own)}
        uses += [edge] * (len(own) + 1)
    onward = [*range(1, len(uses)), 0]
    for k in sorted(stop_at, reverse=True):
        onward[k] = onward[k + 1]
    return uses, stop_at, onward


def _add_stop(group: list[Row], rows: list[Row], after: int, stop: Stop) -> None:
    """Let the vehicles on an edge stop on one of its lanes; `after` is the first row of its next use."""
    _, index, begin, end, duration = stop
    for row in group:
        row.length = min(row.length, end)
    row = group[index]
    row.stop, row.next, row.chosen = (begin, end, duration), after + index, []
    row.length = rows[row.next].length


def _end(group: list[Row], arrival: tuple[int, float]) -> None:
    """Write how far the lanes of a route's last edge lead."""
    for index, row in enumerate(group):
        row.arrival, row.chains = min(arrival[1], row.length), []
        if arrival[0] in (-1, index) or arrival[0] >= len(group):
            row.length += ARRIVES
        else:
            row.length = row.arrival


def _choose_chain(graph: LaneGraph, row: Row, rows: list[Row], first: int, edge: int) -> None:
    """Choose the way into the lane that leads farthest on the route, then with the fewest changes."""

    def target(chain: list[int]) -> int:
        return first + chain[-1] - int(graph.edge_first_lane[edge])

    def worth(chain: list[int]) -> tuple[float, int]:
        return min(rows[target(chain)].length, FARTHEST), -abs(rows[target(chain)].changes)

    row.chosen = max(row.chains, key=worth)
    row.next = target(row.chosen)
    row.length = float(graph.length[[row.lane, *row.chosen[:-1]]].sum()) + rows[row.next].length


def _add_inside(graph: LaneGraph, rows: list[Row]) -> None:
    """Add rows for the lanes inside junctions; those of ways side by side are neighbours, too."""
    begin = []
    for row in list(rows):
        following, inside = row.next, row.chosen[:-1]
        begin.append(len(rows))
        for place, lane in enumerate(inside):
            length = float(graph.length[inside[place:]].sum()) + rows[following].length
            rows.append(Row(lane, length, following if place == len(inside) - 1 else len(rows) + 1))
        row.next = begin[-1] if inside else following
    for row, inside in zip(rows, begin, strict=False):
        for place, lane in enumerate(row.chosen[:-1]):
            if row.left >= 0 and rows[row.left].chosen[place : place + 1] == [graph.left[lane]]:
                rows[inside + place].left = begin[row.left] + place
                rows[begin[row.left] + place].right = inside + place
