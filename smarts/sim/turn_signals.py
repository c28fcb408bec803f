"""Turn signals: the edge that each vehicle takes next, by its planned route.

A driver reads from another's turn signal which way it takes across the junction ahead, not where it drives
behind it. So `vehicles.next_edge` shows the next edge alone. It changes where a vehicle comes to another
edge, or gets another route.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from smarts.arrays import Bools, Ints
from smarts.geometry.binding import bind
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads
from smarts.roads.lane_graph import LaneGraph
from smarts.roads.scene import Scene
from smarts.types import columns
from smarts.types.planned_routes import RouteEdges
from smarts.types.world import State


class Shown(NamedTuple):
    """Vehicle, route and edge for which each slot's signal was set last, shape (B, V) each."""

    generation: Ints
    route: Ints
    edge: Ints
    """Edge, numbered across all maps; -1 for none."""


class TurnSignals:
    """Writes `vehicles.next_edge` and `world.route_place`; part of the map-matching stage, at its end.

    Args:
        scene: The world and its maps.
    """

    def __init__(self, scene: Scene) -> None:
        world, atlas = scene.world, scene.atlas
        ends = [_ends_of(graph, edge) for graph in atlas.graphs for edge in range(len(graph.edge_ids))]
        shown = columns.allocate(Shown, world.vehicles.alive.shape, unset=Shown._fields)
        table = world.routes.table, np.array(ends, np.int32)
        self.show: Callable[[Bools], None] = bind(
            show_turns, world.state, atlas.roads, *table, shown, world.route_place
        )
        """See `show_turns`; takes `env_mask`."""


def _ends_of(graph: LaneGraph, edge: int) -> tuple[int, int]:
    """Return the edges before and behind an edge inside a junction; another edge itself and -1."""
    if not graph.edge_is_internal[edge]:
        return edge, -1
    lane = graph.edge_lanes(edge)[0]
    return _road_of(graph, lane, graph.predecessors), _road_of(graph, lane, graph.successors)


def _road_of(graph: LaneGraph, lane: int, neighbours: Callable[[int], Ints]) -> int:
    """Return the edge outside the junction to which a lane inside it is joined on one side, -1 for none."""
    while graph.is_internal[lane]:
        joined = neighbours(lane)
        if not len(joined):
            return -1
        lane = int(joined[0])
    return int(graph.lane_edge[lane])


@kernel
def show_turns(
    state: State,
    roads: Roads,
    routes: RouteEdges,
    ends: Ints,
    shown: Shown,
    place: Ints,
    env_mask: Bools,
) -> None:
    """Write the next edges of vehicles that have come to another edge, or have another route.

    Args:
        state: The state of the world; `next_edge` is written.
        roads: The maps' lanes.
        routes: The planned routes.
        ends: Edges before and behind each edge inside a junction; another edge itself and -1, shape (E, 2).
        shown: Written.
        place: `World.route_place`, written.
        env_mask: The simulations, shape (B,).
    """
    vehicles = state.vehicles
    for b in np.flatnonzero(env_mask):
        if state.step[b] == 0:
            # Generations begin again with the episode.
            shown.generation[b, :] = -1
        lanes, edges = roads.lane_base[state.map[b]], roads.edge_base[state.map[b]]
        for slot in range(state.used[b]):
            if not vehicles.alive[b, slot] or vehicles.lane[b, slot] < 0:
                continue
            lane, route = lanes + vehicles.lane[b, slot], vehicles.route[b, slot]
            is_new = shown.generation[b, slot] != vehicles.generation[b, slot]
            is_new |= shown.route[b, slot] != route
            edge = roads.lane_edge[lane]
            if not is_new and (roads.lane_inside[lane] or edge == shown.edge[b, slot]):
                continue
            shown.generation[b, slot], shown.route[b, slot] = vehicles.generation[b, slot], route
            shown.edge[b, slot], vehicles.next_edge[b, slot] = edge, -1
            if route >= 0:
                here = 0 if is_new else place[b, slot]
                planned = routes.edge[b, routes.first[b, route] : routes.first[b, route + 1]]
                found = _place_after(planned, here, edge - edges, ends[edge])
                place[b, slot] = here if found < 0 else found
                if 0 <= found < len(planned):
                    vehicles.next_edge[b, slot] = planned[found]


@kernel
def _place_after(planned: Ints, here: int, edge: int, ends: Ints) -> int:
    """Return the place of the edge after `edge` on a route, from place `here` on if it is there; -1 for none.

    Routes have no edges inside junctions: there it is the first one that follows the edge before the
    junction, or is the edge behind it.
    """
    if here < len(planned) and planned[here] == edge:
        # It has come to the edge that it showed.
        return here + 1
    before, behind, first = ends[0], ends[1], -1
    for place in range(len(planned) + 1):
        is_next = place > 0 and planned[place - 1] == before
        if is_next or (behind >= 0 and place < len(planned) and planned[place] == behind):
            if place >= here:
                return place
            first = place if first < 0 else first
    return first
