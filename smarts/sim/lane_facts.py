"""What the judges of events ask of lanes, for all maps of an atlas in a row."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smarts.roads.atlas import RoadAtlas

Bools = NDArray[np.bool_]
Ints = NDArray[np.int32]
Floats = NDArray[np.float64]

_BESIDE = 1.0
"""How far beyond a road's left edge to look for the road of the other direction [m]."""


class LaneFacts(NamedTuple):
    """Shape (L,) unless said otherwise, lanes numbered across all maps as in `Roads`."""

    edge: Ints
    """Across all maps."""
    junction: Ints
    """That the lane lies in, within its own map; -1 for road lanes."""
    twin: Ints
    """Lane of the other direction at the left edge of the lane's road, -1 where there is none."""
    is_dead_end: Bools
    """Whether the lane leads nowhere."""
    conflict_start: Ints
    """CSR of the conflicts of each lane, shape (L + 1,); see `LaneGraph.conflict_start`."""
    conflict_lane: Ints
    """The other lane, shape (C,)."""
    conflict_extent: Floats
    """Where the two overlap along the lane, from and to [m], shape (C, 2)."""
    conflict_other_extent: Floats
    """The same along the other lane [m], shape (C, 2)."""


def lane_facts(atlas: RoadAtlas) -> LaneFacts:
    """Return the facts of all lanes of an atlas."""
    graphs = atlas.graphs
    bases = np.cumsum([0, *(len(graph.edge_ids) for graph in graphs)])
    edges = [graph.lane_edge + base for graph, base in zip(graphs, bases, strict=False)]
    edge = np.concatenate(edges).astype(np.int32)
    counts = np.concatenate([np.diff(graph.conflict_start) for graph in graphs])
    lane_bases = atlas.roads.lane_base
    return LaneFacts(
        edge=edge,
        junction=np.concatenate([graph.lane_junction for graph in graphs]).astype(np.int32),
        twin=_twins(atlas, edge),
        is_dead_end=np.concatenate([np.diff(graph.successor_start) == 0 for graph in graphs]),
        conflict_start=np.cumsum([0, *counts]).astype(np.int32),
        conflict_lane=np.concatenate(
            [graph.conflict_lane + base for graph, base in zip(graphs, lane_bases, strict=False)]
        ).astype(np.int32),
        conflict_extent=np.concatenate([graph.conflict_extent for graph in graphs]),
        conflict_other_extent=np.concatenate([graph.conflict_other_extent for graph in graphs]),
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
