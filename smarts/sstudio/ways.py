"""Lanes on the way of a mission, and roads beside it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable

import numpy as np
import shapely

from smarts.roads.lane_graph import OPPOSITE, LaneGraph

FARTHEST_BESIDE = 50.0
"""Largest distance of roads that lie beside each other [m]."""


def is_on_way(roads: LaneGraph, lane: int, edges: Collection[str]) -> bool:
    """Return whether a lane belongs to one of some edges, or joins two of them inside a junction."""
    if not roads.is_internal[lane]:
        return _edge(roads, lane) in edges
    ends = (_out_of_junction(roads, lane, onward) for onward in (roads.predecessors, roads.successors))
    return all(not end.isdisjoint(edges) for end in ends)


def leads_back_beside(roads: LaneGraph, lane: int, s: float, back: int) -> bool:
    """Return whether a lane has another one beside it, in the other direction, from arc length `s` [m] on."""
    here = slice(roads.point_start[lane], roads.point_start[lane + 1])
    there = slice(roads.point_start[back], roads.point_start[back + 1])
    ahead = roads.point_s[here] >= min(s, roads.point_s[here][-1])
    points, others = roads.point_xy[here][ahead], roads.point_xy[there]
    tree = shapely.STRtree(shapely.points(others))  # pyright: ignore[reportArgumentType]
    nearest = tree.nearest(shapely.points(points))
    distances = np.linalg.norm(points - others[nearest], axis=1)
    turn = np.cos(roads.point_heading[here][ahead] - roads.point_heading[there][nearest])
    # A point nearest to an end of the other lane may lie before or behind that lane.
    between = (nearest > 0) & (nearest < len(others) - 1)
    return bool((between & (turn <= OPPOSITE) & (distances <= FARTHEST_BESIDE)).any())


def _out_of_junction(roads: LaneGraph, lane: int, onward: Callable[[int], Iterable[int]]) -> set[str]:
    """Return the edges that a lane inside a junction leads to."""
    found: set[str] = set()
    open_lanes, seen = [lane], {lane}
    while open_lanes:
        for each in map(int, onward(open_lanes.pop())):
            if each in seen:
                continue
            seen.add(each)
            if roads.is_internal[each]:
                open_lanes.append(each)
            else:
                found.add(_edge(roads, each))
    return found


def _edge(roads: LaneGraph, lane: int) -> str:
    return roads.edge_ids[roads.lane_edge[lane]]
