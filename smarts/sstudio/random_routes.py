"""Routes drawn from a map."""

from __future__ import annotations

from typing import TYPE_CHECKING

from smarts.roads.lane_graph import LaneGraph
from smarts.roads.routes import CARS, random_route
from smarts.sstudio.sstypes.route import Route

if TYPE_CHECKING:
    from numpy.random import Generator

TRIES = 100
MOST_EDGES = 10
"""Largest number of edges, as in the original, so that routes are about as long."""


def draw_route(roads: LaneGraph, generator: Generator, users: str = "cars") -> Route:
    """Return a route of at most ten edges, and of two at least if the map has such.

    Raises:
        MapError: No edge is open to `users`, as which errors name the vehicles.
    """
    edges = random_route(roads, generator, max_edges=MOST_EDGES, users=users)
    for _ in range(TRIES):
        if len(edges) > 1:
            break
        edges = random_route(roads, generator, max_edges=MOST_EDGES)
    begin, end = (_place(roads, edge, generator) for edge in (edges[0], edges[-1]))
    if len(edges) == 1:
        begin, end = sorted((begin, end), key=lambda place: place[2])
    return Route(begin=begin, end=end, via=edges[1:-1])


def _place(roads: LaneGraph, edge: str, generator: Generator) -> tuple[str, int, float]:
    lanes = [lane for lane in roads.edge_lanes(roads.edge_number(edge)) if roads.kind[lane] in CARS]
    lane = lanes[int(generator.integers(len(lanes)))]
    # Whole centimetres keep the files readable.
    offset = round(float(generator.uniform(0.0, roads.sumo_length[lane])) - 0.005, 2)
    return edge, int(roads.lane_index[lane]), max(offset, 0.0)
