"""What the judges of events ask of lanes, for all maps of an atlas in a row."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smarts.roads.atlas import RoadAtlas

Bools = NDArray[np.bool_]
Ints = NDArray[np.int32]

_BESIDE = 1.0
"""How far beyond a road's left edge to look for the road of the other direction [m]."""


class LaneFacts(NamedTuple):
    """Shape (L,), lanes numbered across all maps as in `Roads`."""

    edge: Ints
    """Across all maps."""
    junction: Ints
    """That the lane lies in, within its own map; -1 for road lanes."""
    twin: Ints
    """Lane of the other direction at the left edge of the lane's road, -1 where there is none."""
    is_dead_end: Bools
    """Whether the lane leads nowhere."""


def lane_facts(atlas: RoadAtlas) -> LaneFacts:
    """Return the facts of all lanes of an atlas."""
    graphs = atlas.graphs
    bases = np.cumsum([0, *(len(graph.edge_ids) for graph in graphs)])
    edges = [graph.lane_edge + base for graph, base in zip(graphs, bases, strict=False)]
    edge = np.concatenate(edges).astype(np.int32)
    return LaneFacts(
        edge=edge,
        junction=np.concatenate([graph.lane_junction for graph in graphs]).astype(np.int32),
        twin=_twins(atlas, edge),
        is_dead_end=np.concatenate([np.diff(graph.successor_start) == 0 for graph in graphs]),
    )


def _twins(atlas: RoadAtlas, edge: Ints) -> Ints:
    """Look to the left of the middle of each road's leftmost lane for a lane of the other direction."""
    counts = [len(graph.lane_ids) for graph in atlas.graphs]
    maps = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
    lane = np.concatenate([np.arange(count, dtype=np.int32) for count in counts])
    length = np.concatenate([graph.length for graph in atlas.graphs])
    width = np.concatenate([graph.width for graph in atlas.graphs])
    position, heading = atlas.poses(maps, lane, length / 2, width / 2 + _BESIDE)
    found = atlas.locate(maps, position, heading + np.pi)
    s, _ = atlas.project(maps, found.lane, position)
    _, other_heading = atlas.poses(maps, found.lane, s, np.zeros(len(lane)))
    is_leftmost = np.concatenate([(graph.left < 0) & ~graph.is_internal for graph in atlas.graphs])
    across = found.lane + atlas.roads.lane_base[maps]
    is_twin = (
        is_leftmost
        & (np.cos(other_heading - heading) < 0.0)
        & (found.distance <= width[across] / 2)
        & ~atlas.roads.lane_inside[across]
    )
    # All lanes of a road have the twin of its leftmost one.
    of_edge = np.full(edge.max() + 1, -1, np.int32)
    of_edge[edge[is_twin]] = across[is_twin]
    return of_edge[edge]
