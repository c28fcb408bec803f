"""Edges inside junctions, which maps get only when they are compiled."""

from __future__ import annotations

from smarts.errors import MapError
from smarts.roads.lane_graph import LaneGraph


def connecting_edge(roads: LaneGraph, begin: int, end: int) -> str:
    """Return the id of the first junction edge on the way from one road lane straight into another.

    Args:
        roads: The map.
        begin: Row of the lane that leads into the junction.
        end: Row of the lane behind it.

    Raises:
        MapError: No junction lane joins the two.
    """
    for inside in roads.successors(begin):
        lane = int(inside)
        # A long turn may have a second junction lane behind its waiting point.
        while roads.is_internal[lane] and len(roads.successors(lane)):
            lane = int(roads.successors(lane)[0])
        if roads.is_internal[inside] and lane == end:
            return roads.edge_ids[roads.lane_edge[inside]]
    exits = sorted({roads.lane_ids[lane] for lane in roads.successors(begin) if not roads.is_internal[lane]})
    raise MapError(
        f"no junction joins lane '{roads.lane_ids[begin]}' to lane '{roads.lane_ids[end]}'",
        remedy=f"it leads straight into {', '.join(exits)}" if exits else "check the connections of the map",
    )
