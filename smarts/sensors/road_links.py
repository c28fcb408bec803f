"""Which lanes lie beside each other on a road, and which way goes straight on, for all maps of an atlas."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from smarts.arrays import Bools, Ints
from smarts.roads.atlas import ROAD_LANES, RoadAtlas
from smarts.roads.lane_graph import LaneGraph
from smarts.roads.memory import remembered


class RoadLinks(NamedTuple):
    """Lanes are numbered across all maps of the atlas, L in all."""

    beside_start: Ints
    """CSR of the lanes of the same road, shape (L + 1,)."""
    beside: Ints
    """Those of the lane's own direction from the right to the left, then the oncoming ones."""
    own_count: Ints
    """How many of them are of the lane's own direction, shape (L,)."""
    ahead: Ints
    """The lane that turns least among those that a lane leads into, -1 at a dead end, shape (L,)."""
    behind: Ints
    """The lane that turns least among those that lead into a lane, -1 if there is none, shape (L,)."""


@remembered(most=1)
def road_links(atlas: RoadAtlas) -> RoadLinks:
    """Return the (remembered) links of an atlas."""
    beside: list[list[int]] = []
    own_count, ahead, behind = [], [], []
    for graph, base in zip(atlas.graphs, atlas.roads.lane_base, strict=False):
        usable = np.isin(graph.kind, list(ROAD_LANES))
        reverse = _reverse_edges(graph)
        for lane in range(len(graph.lane_ids)):
            edge = int(graph.lane_edge[lane])
            own = _usable_lanes(graph, [edge], usable)
            oncoming = _usable_lanes(graph, reverse[edge], usable)
            beside.append([number + int(base) for number in (*own, *oncoming)])
            own_count.append(len(own))
            for found, places in ((ahead, graph.successors(lane)), (behind, graph.predecessors(lane))):
                least = _straightest(graph, lane, places[usable[places]].tolist())
                found.append(-1 if least < 0 else least + int(base))
    return RoadLinks(
        beside_start=np.cumsum([0, *(len(lanes) for lanes in beside)]).astype(np.int32),
        beside=np.array([number for lanes in beside for number in lanes], np.int32),
        own_count=np.array(own_count, np.int32),
        ahead=np.array(ahead, np.int32),
        behind=np.array(behind, np.int32),
    )


def _usable_lanes(graph: LaneGraph, edges: list[int], usable: Bools) -> list[int]:
    return [number for edge in edges for number in graph.edge_lanes(edge) if usable[number]]


def _reverse_edges(graph: LaneGraph) -> list[list[int]]:
    """Return for each edge the road edges that lead back along it: their ends are its, and side by side."""
    reverse: list[list[int]] = [[] for _ in graph.edge_ids]
    leading: dict[tuple[int, int], list[int]] = {}
    for edge in np.flatnonzero(~graph.edge_is_internal).tolist():
        leading.setdefault((int(graph.edge_from[edge]), int(graph.edge_to[edge])), []).append(edge)
    for (begin, end), edges in leading.items():
        back = leading.get((end, begin), [])
        for edge in edges:
            reverse[edge] = [other for other in back if other != edge and _is_beside(graph, edge, other)]
    return reverse


def _is_beside(graph: LaneGraph, edge: int, other: int) -> bool:
    """Tell whether the leftmost lanes of two edges come as near as neighbours would at their middles."""
    lane, facing = graph.edge_lanes(edge)[-1], graph.edge_lanes(other)[-1]
    middle = np.array(graph.pose_at(lane, float(graph.length[lane]) / 2)[:2])
    gap = np.hypot(*(graph.centreline(facing) - middle).T).min()
    return bool(gap < 2 * (graph.width[lane] + graph.width[facing]))


def _straightest(graph: LaneGraph, lane: int, linked: list[int]) -> int:
    """Return the linked lane whose far end points most nearly where this lane does, -1 if there is none."""
    if not linked:
        return -1
    first, last = graph.point_start[:-1], graph.point_start[1:] - 1
    ahead = set(linked) <= set(graph.successors(lane).tolist())
    own = graph.point_heading[last[lane] if ahead else first[lane]]
    turns = [np.cos(graph.point_heading[last[n] if ahead else first[n]] - own) for n in linked]
    return linked[int(np.argmax(turns))]
