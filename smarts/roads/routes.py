"""Routes: shortest ways through the edges of a lane graph, and random ones."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Iterable, Sequence
from typing import Literal

import numpy as np

from smarts.errors import MapError
from smarts.roads.lane_graph import OPPOSITE, LaneGraph, LaneKind
from smarts.roads.memory import remembered

Cost = Literal["length", "time"]


class EdgeGraph:
    """The successors of road edges for users of some kinds of lanes, with costs."""

    def __init__(self, graph: LaneGraph, kinds: frozenset[LaneKind], cost: Cost) -> None:
        usable = np.isin(graph.kind, list(kinds))
        lane_cost = graph.length if cost == "length" else graph.length / np.maximum(graph.speed_limit, 0.1)
        edges = range(len(graph.edge_ids))
        self.cost = [
            min((float(lane_cost[lane]) for lane in graph.edge_lanes(edge) if usable[lane]), default=np.inf)
            for edge in edges
        ]
        """Cost of each edge; infinite where no lane is usable."""
        self.onward: list[dict[int, float]] = [{} for _ in edges]
        """Edges that follow each edge, with the least cost of the junction between."""
        for lane in np.flatnonzero(usable & ~graph.is_internal):
            following = self.onward[graph.lane_edge[lane]]
            for *inside, target in reversed([*graph.ways_from(int(lane), usable)]):
                edge, between = int(graph.lane_edge[target]), sum(float(lane_cost[each]) for each in inside)
                following[edge] = min(between, following.get(edge, np.inf))


def names_of(kinds: Iterable[LaneKind]) -> str:
    """Return kinds of lanes as errors name them."""
    return ", ".join(sorted(kind.name for kind in kinds))


CARS = frozenset({LaneKind.CAR})
"""The lanes that passenger cars may use."""


def shortest_route(
    graph: LaneGraph,
    begin: str,
    end: str,
    via: Sequence[str] = (),
    *,
    lap: bool = False,
    cost: Cost = "length",
    kinds: frozenset[LaneKind] = CARS,
    users: str = "the route's vehicles",
) -> tuple[str, ...]:
    """Return the road edges from `begin` to `end`, both included, by way of the `via` edges in their order.

    Args:
        graph: The map.
        begin: Id of the first edge.
        end: Id of the last edge.
        via: Ids of edges to pass in between.
        lap: Whether to leave and come round again where two neighbouring waypoints are the same edge, as a
            trip to a point behind its own beginning must; otherwise they count as one.
        cost: What to minimise, "length" [m] or "time" at the speed limit [s]. Of equal ways the one whose
            edges come earlier in the map wins.
        kinds: The lanes that may be used.
        users: What uses them, for errors.

    Raises:
        MapError: An edge does not exist, lies inside a junction or is closed to the user, or no way leads on.
    """
    edges = edge_graph(graph, kinds, cost)
    stops = [_road_edge(graph, edges, name, users) for name in (begin, *via, end)]
    route = stops[:1]
    for source, target in itertools.pairwise(stops):
        if source == target and not lap:
            continue
        leg = _shortest_leg(edges, source, target)
        if leg is None:
            raise MapError(
                f"no way for {users} leads from edge '{graph.edge_ids[source]}' "
                f"to edge '{graph.edge_ids[target]}'",
                remedy=_reachable(graph, edges, source),
            )
        route += leg
    return tuple(graph.edge_ids[edge] for edge in route)


def random_route(
    graph: LaneGraph,
    generator: np.random.Generator,
    *,
    max_edges: int = 10,
    users: str = "the route's vehicles",
) -> tuple[str, ...]:
    """Return a random walk over at most `max_edges` road edges, shorter where the road ends.

    It begins on any edge with an exit, if the map has one, and takes every exit with equal chance.
    Turnarounds, which no vehicle can drive within a road's width, are no exits.

    Raises:
        MapError: No edge is open to the lanes' users.
    """
    edges = edge_graph(graph, CARS, "length")
    usable = np.flatnonzero(np.isfinite(edges.cost) & ~graph.edge_is_internal).tolist()
    if not usable:
        raise MapError(
            f"no road of the map is open to {users}", remedy="use another vehicle type, or another map"
        )
    begins = [edge for edge in usable if _exits_without_turnarounds(graph, edges, edge)] or usable
    route = [begins[generator.integers(len(begins))]]
    while len(route) < max_edges and (exits := _exits_without_turnarounds(graph, edges, route[-1])):
        route.append(exits[generator.integers(len(exits))])
    return tuple(graph.edge_ids[edge] for edge in route)


def _exits_without_turnarounds(graph: LaneGraph, edges: EdgeGraph, edge: int) -> list[int]:
    """Return the edges that follow an edge, without turnarounds onto its opposite direction."""
    end = graph.point_heading[graph.point_start[graph.edge_first_lane[edge] + 1] - 1]
    exits = np.array(sorted(edges.onward[edge]), np.int64)
    begins = graph.point_heading[graph.point_start[graph.edge_first_lane[exits]]]
    return exits[np.cos(begins - end) > OPPOSITE].tolist()


@remembered(most=8)
def edge_graph(graph: LaneGraph, kinds: frozenset[LaneKind] = CARS, cost: Cost = "length") -> EdgeGraph:
    """Return the (remembered) edge graph of a map for users of certain lanes."""
    return EdgeGraph(graph, kinds, cost)


def _road_edge(graph: LaneGraph, edges: EdgeGraph, name: str, users: str) -> int:
    edge = graph.edge_number(name)
    if graph.edge_is_internal[edge]:
        raise MapError(f"edge '{name}' lies inside a junction", remedy="a route is made of road edges only")
    if not np.isfinite(edges.cost[edge]):
        raise MapError(
            f"edge '{name}' is closed to {users}",
            remedy="choose an edge with a lane for them, or another vehicle type",
        )
    return edge


def _shortest_leg(edges: EdgeGraph, source: int, target: int) -> list[int] | None:
    """Return the edges after `source` up to `target` (a full lap if they are equal), or None."""
    best: dict[int, float] = {}
    before: dict[int, int] = {}
    queue = [(0.0, source)]
    done: set[int] = set()
    while queue:
        cost, edge = heapq.heappop(queue)
        if edge == target and before:
            return _trace(before, source, target)
        if edge in done:
            continue
        if before:
            done.add(edge)
        for following, between in edges.onward[edge].items():
            total = cost + between + edges.cost[following]
            if total < best.get(following, np.inf):
                best[following], before[following] = total, edge
                heapq.heappush(queue, (total, following))
    return None


def _trace(before: dict[int, int], source: int, target: int) -> list[int]:
    leg = [target]
    while before[leg[-1]] != source:
        leg.append(before[leg[-1]])
    return leg[::-1]


def _reachable(graph: LaneGraph, edges: EdgeGraph, source: int) -> str:
    names = [graph.edge_ids[edge] for edge in sorted(edges.onward[source])]
    if not names:
        return f"edge '{graph.edge_ids[source]}' is a dead end for them"
    return (
        f"edge '{graph.edge_ids[source]}' leads into {', '.join(map(repr, names[:8]))}; "
        "check the connections, and to which vehicle types they are open"
    )
