"""The lanes of several maps, and routes on them, as plain arrays for kernels.

Axis letters: M maps, L lanes of all maps, P points of their centrelines.
"""

from __future__ import annotations

from typing import NamedTuple

from smarts.arrays import Bools, Bytes, Floats, Ints

MOST_CANDIDATES = 1024
"""Most runs in a cell of the grid that kernels consider; the densest junction of the benchmark has 17."""


class Roads(NamedTuple):
    """The lanes of several maps in a row, L in all, and a spatial grid for each map."""

    lane_base: Ints
    """First lane of each map, shape (M + 1,)."""
    lane_index: Ints
    """Place across the road, 0 is the rightmost, shape (L,)."""
    lane_width: Floats
    """[m], shape (L,)."""
    lane_speed: Floats
    """Limit [m/s], shape (L,)."""
    lane_kind: Bytes
    """A `LaneKind`, shape (L,)."""
    lane_inside: Bools
    """Whether the lane is inside a junction, shape (L,)."""
    lane_edge: Ints
    """Across all maps, shape (L,)."""
    edge_base: Ints
    """First edge of each map, shape (M + 1,)."""
    lane_junction: Ints
    """Junction that the lane lies in, within its own map; -1 for road lanes, shape (L,)."""
    lane_left: Ints
    """Lane to the left in the same direction, -1 for none, shape (L,)."""
    lane_right: Ints
    """Lane to the right in the same direction, -1 for none, shape (L,)."""
    lane_twin: Ints
    """Lane of the other direction at the left edge of the lane's road, -1 for none, shape (L,)."""
    lane_dead_end: Bools
    """Whether the lane leads nowhere, shape (L,)."""
    conflict_start: Ints
    """CSR of the conflicts of each lane, shape (L + 1,); see `LaneGraph.conflict_start`."""
    conflict_lane: Ints
    """The other lane, shape (C,)."""
    conflict_kind: Bytes
    """A `ConflictKind`, shape (C,)."""
    conflict_yields: Bytes
    """A `Yields`, shape (C,)."""
    conflict_extent: Floats
    """Extent of the overlap along the lane, from and to [m], shape (C, 2)."""
    conflict_other_extent: Floats
    """The same along the other lane [m], shape (C, 2)."""
    point_start: Ints
    """CSR of the centrelines, shape (L + 1,)."""
    point_xy: Floats
    """[m], shape (P, 2)."""
    point_z: Floats
    """Height [m], shape (P,)."""
    point_heading: Floats
    """[rad], shape (P,)."""
    point_s: Floats
    """[m], shape (P,)."""
    grid_origin: Floats
    """[m], shape (M, 2)."""
    grid_size: Floats
    """Side of a cell [m], shape (M,)."""
    grid_shape: Ints
    """Columns and rows, shape (M, 2)."""
    cell_base: Ints
    """First cell of each map, shape (M,)."""
    run_start: Ints
    """CSR of the runs of each cell."""
    run: Ints
    """Rows (lane, first point, last point)."""
    outline_start: Ints
    """CSR of the junctions of each cell."""
    outline: Ints
    """Junctions."""
    vertex_start: Ints
    """CSR of the junctions' outlines."""
    vertex: Floats
    """[m]."""
    outline_z: Floats
    """Height of each junction [m]."""


class RouteTable(NamedTuple):
    """The corridors of several routes in a row: first one without a route for each map, then the routes."""

    number: Ints
    """Route of each agent, -1 without one, shape (B, A); (0, 0) in a table that serves no agents."""
    free: int
    """M, the number of corridors without a route."""
    start: Ints
    """CSR of the rows of each corridor."""
    lane: Ints
    """Numbered across all maps."""
    group: Ints
    """Rows with the same number are side by side; unique across the table."""
    begin: Floats
    end: Floats
    onward_start: Ints
    onward: Ints
    """Rows of this table."""
    before: Ints
    """Row of the lane before on the same way through a junction, -1 where the way begins."""
    by_lane: Ints
    """Rows of each corridor in ascending order of lane."""
    changes: Bytes
    """Lane changes from each row to the k-th lane from the end of the corridor, as `Corridor.changes`; 0
    where the last edge has fewer lanes, shape (R, K)."""
