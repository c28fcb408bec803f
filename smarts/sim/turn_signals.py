"""Turn signals: the edge that each vehicle takes next, by its planned route.

A driver reads from another's turn signal which way it takes across the junction ahead, not where it drives
behind it. So `vehicles.next_edge` shows the next edge alone. It changes where a vehicle comes to another
edge, or gets another route, which is rare: a kernel finds these vehicles.
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
from smarts.types.world import State


class Shown(NamedTuple):
    """Vehicle, route and edge for which each slot's signal was set last, shape (B, V) each."""

    generation: Ints
    route: Ints
    edge: Ints
    """Edge of the map, -1 for none."""


class TurnSignals:
    """Writes `vehicles.next_edge` and `world.route_place`; part of the map-matching stage, at its end.

    Args:
        scene: The world and its maps.
    """

    def __init__(self, scene: Scene) -> None:
        world = scene.world
        self._maps, self._graphs = world.map, scene.atlas.graphs
        self._next, self._planned = world.vehicles.next_edge, world.routes
        shape = world.vehicles.alive.shape
        self._place = world.route_place
        self._found = np.zeros((shape[0] * shape[1], 5), np.int32)
        shown = columns.allocate(Shown, shape, unset=Shown._fields)
        self._find = bind(find_turned, world.state, scene.atlas.roads, shown, self._found)

    def show(self, env_mask: Bools) -> None:
        """Write the next edges of the vehicles that have come to another edge, or have another route."""
        count = self._find(env_mask)
        if count:
            for row, slot, route, edge, is_new in self._found[:count].tolist():
                if is_new:
                    self._place[row, slot] = 0
                self._next[row, slot] = self._edge_after(row, slot, route, edge)

    def _edge_after(self, row: int, slot: int, route: int, edge: int) -> int:
        """Return the edge after `edge` on a route, -1 if there is none.

        Routes have no edges inside junctions: there it is the first one that follows the edge before the
        junction, or is the edge behind it.
        """
        edges, place = self._planned.edges(row, route), int(self._place[row, slot])
        if place < len(edges) and edges[place] == edge:
            # It has come to the edge that it showed.
            self._place[row, slot] = place + 1
            return int(edges[place + 1]) if place + 1 < len(edges) else -1
        before, behind = _ends_of(self._graphs[self._maps[row]], edge)
        places = np.flatnonzero(edges == before) + 1
        if behind >= 0:
            places = np.sort(np.append(places, np.flatnonzero(edges == behind)))
        if not len(places):
            return -1
        ahead = places[places >= place]
        place = int(ahead[0] if len(ahead) else places[0])
        self._place[row, slot] = place
        return int(edges[place]) if place < len(edges) else -1


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
def find_turned(state: State, roads: Roads, shown: Shown, found: Ints, env_mask: Bools) -> int:
    """Find the vehicles whose signals are to be set; clear the signals of vehicles without a route.

    Args:
        state: The state of the world; the next edges of vehicles without a route are written.
        roads: The maps' lanes.
        shown: Written.
        found: Written: rows of simulation, slot, route, edge, and whether the route is new, shape (B V, 5).
        env_mask: The simulations, shape (B,).

    Returns:
        How many rows were written.
    """
    vehicles, count = state.vehicles, 0
    for b in np.flatnonzero(env_mask):
        if state.step[b] == 0:
            # Generations begin again with the episode.
            shown.generation[b, :] = -1
        lanes, edges = roads.lane_base[state.map[b]], roads.edge_base[state.map[b]]
        for slot in range(vehicles.alive.shape[1]):
            if not vehicles.alive[b, slot] or vehicles.lane[b, slot] < 0:
                continue
            lane, route = lanes + vehicles.lane[b, slot], vehicles.route[b, slot]
            is_new = shown.generation[b, slot] != vehicles.generation[b, slot]
            is_new |= shown.route[b, slot] != route
            edge = roads.lane_edge[lane] - edges
            if not is_new and (roads.lane_inside[lane] or edge == shown.edge[b, slot]):
                continue
            shown.generation[b, slot], shown.route[b, slot] = vehicles.generation[b, slot], route
            shown.edge[b, slot] = edge
            if route < 0:
                vehicles.next_edge[b, slot] = -1
                continue
            found[count, 0], found[count, 1], found[count, 2] = b, slot, route
            found[count, 3], found[count, 4] = edge, is_new
            count += 1
    return count
