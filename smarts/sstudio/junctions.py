"""Edges inside junctions, which maps get only when they are compiled."""

from __future__ import annotations

from smarts.errors import MapError
from smarts.roads.lane_graph import LaneGraph


def connecting_edge(roads: LaneGraph, begin: int, end: int) -> str:
    """Return the id of the first junction edge on the way from one road lane straight into another.

    Where nothing joins these two lanes, as in the original the way between any lanes of the two edges counts.

    Args:
        roads: The map.
        begin: Row of the lane that leads into the junction.
        end: Row of the lane behind it.

    Raises:
        MapError: No junction joins the two edges.
    """
    edge, target = int(roads.lane_edge[begin]), int(roads.lane_edge[end])
    for exact, lane in [(True, begin), *((False, lane) for lane in roads.edge_lanes(edge))]:
        for inside, behind in _crossings(roads, lane):
            if behind == end or (not exact and roads.lane_edge[behind] == target):
                return roads.edge_ids[roads.lane_edge[inside]]
    beyond = {
        roads.edge_ids[roads.lane_edge[behind]]
        for lane in roads.edge_lanes(edge)
        for _, behind in _crossings(roads, lane)
    }
    raise MapError(
        f"no junction joins edge '{roads.edge_ids[edge]}' to edge '{roads.edge_ids[target]}'",
        remedy=f"it leads into {', '.join(map(repr, sorted(beyond)))}" if beyond else "it is a dead end",
    )


def _crossings(roads: LaneGraph, lane: int) -> list[tuple[int, int]]:
    """Return the first junction lane and the road lane behind the junction, for every way out of a lane."""
    inside = [each for each in roads.successors(lane).tolist() if roads.is_internal[each]]
    # A long turn may have a second junction lane behind its waiting point.
    return [(each, roads.way_across(each)[-1]) for each in inside]
