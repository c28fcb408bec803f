"""What the kernels read: the lanes of several maps, and routes on them, as plain arrays.

Axis letters: M maps, L lanes of all maps, P points of their centrelines.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]


MOST_CANDIDATES = 1024
"""How many runs a cell of the grid may list. `packing.pack_roads` refuses maps with more, so that kernels
drop none silently; the densest junction of the benchmark's maps has 17."""


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
    lane_kind: NDArray[np.int8]
    """A `LaneKind`, shape (L,)."""
    lane_inside: NDArray[np.bool_]
    """Whether the lane is inside a junction, shape (L,)."""
    point_start: Ints
    """CSR of the centrelines, shape (L + 1,)."""
    point_xy: Floats
    """[m], shape (P, 2)."""
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


class RouteTable(NamedTuple):
    """The corridors of several routes in a row: first one without a route for each map, then the routes."""

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
    """Within each corridor its rows in ascending order of lane."""
    changes: NDArray[np.int8]
    """Lane changes from each row to the k-th lane from the end of the corridor, as `Corridor.changes`; 0
    where the last edge has fewer lanes, shape (R, K)."""
