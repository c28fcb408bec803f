"""Lanes on the way of a mission."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable

from smarts.roads.lane_graph import LaneGraph


def is_on_way(roads: LaneGraph, lane: int, edges: Collection[str]) -> bool:
    """Return whether a lane belongs to one of some edges, or joins two of them inside a junction."""
    if not roads.is_internal[lane]:
        return _edge(roads, lane) in edges
    ends = (_out_of_junction(roads, lane, onward) for onward in (roads.predecessors, roads.successors))
    return all(not end.isdisjoint(edges) for end in ends)


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
