"""Where recorded positions are on a map: lanes and routes."""

from __future__ import annotations

import numpy as np

from smarts.arrays import Floats, Ints
from smarts.errors import MapError
from smarts.roads.atlas import ROAD_LANES, NearestLanes, RoadAtlas
from smarts.roads.lane_graph import LaneGraph
from smarts.roads.routes import shortest_route

MOST_MISSED = 3
"""A vehicle may have passed so many short edges between two samples."""


def lanes_of(position: Floats, heading: Floats, roads: LaneGraph) -> NearestLanes:
    """Return the lane of each pose, positions of shape (N, 2)."""
    maps, height = np.zeros(len(position), np.int32), np.full(len(position), np.nan)
    return RoadAtlas([roads]).locate(maps, position, heading, height=height)


def routes_of(
    position: Floats, heading: Floats, start: Ints, roads: LaneGraph
) -> tuple[tuple[int, ...], ...]:
    """Return the numbers of the road edges along each track.

    Args:
        position: Of all samples [m], shape (N, 2).
        heading: [rad], shape (N,).
        start: First sample of each track, and N, shape (T + 1,).
        roads: The map.
    """
    found = lanes_of(position, heading, roads)
    is_on = (found.lane >= 0) & (found.distance <= 0.5 * roads.width[found.lane])
    edge = np.where(is_on & ~roads.is_internal[found.lane], roads.lane_edge[found.lane], -1)
    tracks = np.split(edge, start[1:-1])
    return tuple(_connected(each[each >= 0], roads) for each in tracks)


def _connected(edges: Ints, roads: LaneGraph) -> tuple[int, ...]:
    """Return edges of which each leads into the next; those to which no short way leads are left out."""
    route: list[int] = []
    for edge in edges[np.append(True, edges[1:] != edges[:-1])].tolist() if len(edges) else ():
        if not route:
            route.append(edge)
        elif edge != route[-1]:
            try:
                way = shortest_route(roads, roads.edge_ids[route[-1]], roads.edge_ids[edge], kinds=ROAD_LANES)
            except MapError:
                continue
            if len(way) <= MOST_MISSED + 2:
                route += [roads.edge_number(each) for each in way[1:]]
    return tuple(route)
