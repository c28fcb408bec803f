"""Routes as rows of lanes: where a lane leads to, and how far without a lane change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from smarts.arrays import Ints
from smarts.providers.native.state import Ways
from smarts.roads.lane_graph import LaneGraph

FARTHEST = 3000.0
"""Lanes that lead farther are equally good [m], as for SUMO's drivers."""
SAME = 1.0
"""Lanes that lead equally far, to so much, are equally good [m]."""
ARRIVES = 1e5
"""Added to how far the lane leads on which a route ends [m]."""


@dataclass
class _Row:
    """A use of a lane by a route, see `Ways`."""

    lane: int
    length: float
    next: int = -1
    left: int = -1
    right: int = -1
    changes: int = 0
    arrival: float = np.inf
    chains: list[list[int]] = field(default_factory=list)
    """Ways through the junction ahead to lanes of the route's next edge."""
    chosen: list[int] = field(default_factory=list)
    """The one that the vehicle takes."""


def route_rows(
    graph: LaneGraph, edges: Sequence[int], arrival: tuple[int, float], *, repeats: bool
) -> tuple[Ways, Ints]:
    """Return a route's rows, and the row of the rightmost lane of each edge, shape (E,).

    Args:
        graph: The map; lanes are numbered within it.
        edges: The route's.
        arrival: Index of the lane on which the route ends, -1 for any, and the arc length there [m].
        repeats: Whether the route goes round: its last edge leads to its first.
    """
    counts = [len(graph.edge_lanes(edge)) for edge in edges]
    first = np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int32)
    rows = [_Row(lane, float(graph.length[lane])) for edge in edges for lane in graph.edge_lanes(edge)]
    last = len(edges) - 1
    for k in range(len(edges)):
        if k == last and not repeats:
            _end(rows[first[k] :], arrival)
            continue
        for row in rows[first[k] : first[k] + counts[k]]:
            row.chains = chains_to(graph, row.lane, edges[(k + 1) % len(edges)])
    # The choice on a circuit's last edges depends on its first ones.
    for k in [*range(last, -1, -1)] * (2 if repeats else 1):
        following = (k + 1) % len(edges)
        group = rows[first[k] : first[k] + counts[k]]
        for row in group:
            if row.chains:
                _choose_chain(graph, row, rows, int(first[following]), edges[following])
        best = max(min(row.length, FARTHEST) for row in group)
        good = [index for index, row in enumerate(group) if row.length >= best - SAME]
        for index, row in enumerate(group):
            row.changes = min((other - index for other in good), key=abs)
            row.left, row.right = (
                int(first[k]) + beside if 0 <= beside < len(group) else -1
                for beside in (index + 1, index - 1)
            )
    _add_inside(graph, rows)
    return _table(rows), first


def _end(rows: list[_Row], arrival: tuple[int, float]) -> None:
    """Write how far the lanes of a route's last edge lead."""
    for index, row in enumerate(rows):
        row.arrival = min(arrival[1], row.length)
        if arrival[0] in (-1, index) or arrival[0] >= len(rows):
            row.length += ARRIVES
        else:
            row.length = row.arrival


def chains_to(graph: LaneGraph, lane: int, edge: int) -> list[list[int]]:
    """Return the ways from a lane through the junction ahead to lanes of an edge, without the lane itself."""
    found = []
    for following in graph.successors(lane).tolist():
        if graph.is_internal[following]:
            found += [[following, *rest] for rest in chains_to(graph, following, edge)]
        elif graph.lane_edge[following] == edge:
            found.append([following])
    return found


def _choose_chain(graph: LaneGraph, row: _Row, rows: list[_Row], first: int, edge: int) -> None:
    """Choose the way into the lane that leads farthest on the route, then with the fewest changes."""

    def target(chain: list[int]) -> int:
        return first + chain[-1] - int(graph.edge_first_lane[edge])

    def worth(chain: list[int]) -> tuple[float, int]:
        return min(rows[target(chain)].length, FARTHEST), -abs(rows[target(chain)].changes)

    row.chosen = max(row.chains, key=worth)
    row.next = target(row.chosen)
    inside = float(graph.length[[row.lane, *row.chosen[:-1]]].sum())
    row.length = inside + rows[row.next].length


def _add_inside(graph: LaneGraph, rows: list[_Row]) -> None:
    """Add rows for the lanes inside junctions; those of ways side by side are neighbours, too."""
    begin: dict[int, int] = {}
    for number, row in enumerate(list(rows)):
        following = row.next
        begin[number] = len(rows)
        for place, lane in enumerate(row.chosen[:-1]):
            more = float(graph.length[row.chosen[place:-1]].sum())
            is_last = place == len(row.chosen) - 2
            rows.append(_Row(lane, more + rows[following].length, following if is_last else len(rows) + 1))
        row.next = begin[number] if len(row.chosen) > 1 else following
    for number, inside in begin.items():
        left = rows[number].left
        for place, lane in enumerate(rows[number].chosen[:-1]):
            if left >= 0 and rows[left].chosen[place : place + 1] == [graph.left[lane]]:
                rows[inside + place].left = begin[left] + place
                rows[begin[left] + place].right = inside + place


def _table(rows: list[_Row]) -> Ways:
    def column(name: str, kind: type) -> np.ndarray:
        return np.array([getattr(row, name) for row in rows], kind)

    whole = [column(name, np.int32) for name in ("lane", "next", "left", "right", "changes")]
    far = [column(name, np.float64) for name in ("length", "arrival")]
    return Ways._make([*whole, *far, np.zeros(len(rows), np.int32)])
