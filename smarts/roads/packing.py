"""Maps and routes packed for the kernels: the arrays of several lane graphs and corridors in a row."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from smarts.arrays import Ints
from smarts.errors import MapError
from smarts.geometry.grid import Grid, build_grid
from smarts.roads.arrays import MOST_CANDIDATES, Roads, RouteTable
from smarts.roads.corridors import Corridor
from smarts.roads.lane_graph import LaneGraph

_CELL = 6.0
"""Side of a grid cell [m]; a lane's width or two, so that a cell lists few lanes."""
_MOST_CELLS = 2_000_000


def pack_roads(graphs: Sequence[LaneGraph]) -> Roads:
    """Return the lanes of all graphs in a row, and a grid over each; the atlas adds `lane_twin`.

    Raises:
        MapError: Too many lanes of a graph overlap.
    """
    grids = [_grid(graph) for graph in graphs]

    def joined(arrays: Iterable[ArrayLike]) -> NDArray:
        return np.concatenate([np.asarray(array) for array in arrays])

    def stacked(starts: Iterable[Ints]) -> Ints:
        """Join CSR starts: each map's numbers go on where those of the map before end."""
        counts = joined(np.diff(start) for start in starts)
        return np.concatenate(([0], np.cumsum(counts))).astype(np.int32)

    def raised(arrays: Iterable[Ints], bases: Ints) -> Ints:
        """Join arrays, raising the numbers in each by its map's base; -1 stays, since it means none."""
        parts = zip(arrays, bases, strict=False)
        return joined(np.where(part < 0, -1, part + base) for part, base in parts).astype(np.int32)

    lane_base = _bases(len(graph.lane_ids) for graph in graphs)
    point_base = _bases(len(graph.point_s) for graph in graphs)
    junction_base = _bases(len(graph.junction_ids) for graph in graphs)[:-1]
    shifts = np.stack((lane_base, point_base, point_base), axis=1)[:-1]
    return Roads(
        lane_base=lane_base,
        lane_index=joined(graph.lane_index for graph in graphs),
        lane_width=joined(graph.width for graph in graphs),
        lane_speed=joined(graph.speed_limit for graph in graphs),
        lane_kind=joined(graph.kind for graph in graphs),
        lane_inside=joined(graph.is_internal for graph in graphs),
        lane_edge=raised(
            (graph.lane_edge for graph in graphs), _bases(len(graph.edge_ids) for graph in graphs)
        ),
        lane_junction=joined(graph.lane_junction for graph in graphs),
        lane_left=raised((graph.left for graph in graphs), lane_base),
        lane_right=raised((graph.right for graph in graphs), lane_base),
        lane_twin=np.full(lane_base[-1], -1, np.int32),
        lane_dead_end=joined(np.diff(graph.successor_start) == 0 for graph in graphs),
        conflict_start=stacked(graph.conflict_start for graph in graphs),
        conflict_lane=raised((graph.conflict_lane for graph in graphs), lane_base),
        conflict_extent=joined(graph.conflict_extent for graph in graphs),
        conflict_other_extent=joined(graph.conflict_other_extent for graph in graphs),
        point_start=stacked(graph.point_start for graph in graphs),
        point_xy=joined(graph.point_xy for graph in graphs),
        point_heading=joined(graph.point_heading for graph in graphs),
        point_s=joined(graph.point_s for graph in graphs),
        grid_origin=np.array([grid.origin for grid in grids]),
        grid_size=np.array([grid.size for grid in grids]),
        grid_shape=np.array([(grid.columns, grid.rows) for grid in grids], np.int32),
        cell_base=_bases(grid.columns * grid.rows for grid in grids),
        run_start=stacked(grid.run_start for grid in grids),
        run=joined(grid.run + shift for grid, shift in zip(grids, shifts, strict=True)),
        outline_start=stacked(grid.outline_start for grid in grids),
        outline=joined(grid.outline + base for grid, base in zip(grids, junction_base, strict=True)),
        vertex_start=stacked(graph.junction_start for graph in graphs),
        vertex=joined(graph.junction_xy for graph in graphs),
    )


def _grid(graph: LaneGraph) -> Grid:
    extent = np.ptp(graph.point_xy, axis=0) + 2 * graph.width.max()
    size = max(_CELL, float(np.sqrt(extent[0] * extent[1] / _MOST_CELLS)))
    # The graph's own arrays are read-only, which would be another signature to compile.
    grid = build_grid(
        np.array(graph.point_start),
        np.array(graph.point_xy),
        # A lane inside a junction counts up to its whole width to either side, see `kernels.locate`.
        np.array(graph.width),
        np.array(graph.junction_start),
        np.array(graph.junction_xy),
        size,
    )
    listed = np.diff(grid.run_start)
    if listed.max() > MOST_CANDIDATES:
        row, column = divmod(int(listed.argmax()), grid.columns)
        x, y = grid.origin + (np.array((column, row)) + 0.5) * size
        raise MapError(
            f"{listed.max()} lanes overlap within {size:.0f} m; at most {MOST_CANDIDATES} may",
            place=f"x = {x:.1f}, y = {y:.1f} on the map",
            remedy="remove the duplicates from the map's source",
        )
    return grid


def _bases(counts: Iterable[int]) -> Ints:
    return np.cumsum([0, *counts]).astype(np.int32)


def pack_routes(
    free: Sequence[tuple[int, Corridor]], own: Sequence[tuple[int, Corridor]], lane_base: Ints
) -> RouteTable:
    """Return a table of corridors with the numbers of their maps: those without a route, then the routes."""
    worlds = [world for world, _ in (*free, *own)]
    corridors = [corridor for _, corridor in (*free, *own)]
    row_base = _bases(len(corridor.lane) for corridor in corridors)
    onward_base = _bases(len(corridor.onward) for corridor in corridors)
    group_base = _bases(int(corridor.group.max(initial=-1)) + 1 for corridor in corridors)

    def joined(parts: Iterable[NDArray], bases: Ints | None = None) -> NDArray:
        """Join arrays, raising the numbers in each by its base; -1 stays, since it means none."""
        if bases is None:
            return np.concatenate(list(parts))
        raised = (np.where(part < 0, part, part + base) for part, base in zip(parts, bases, strict=True))
        return np.concatenate(list(raised))

    most = max((corridor.changes.shape[1] for corridor in corridors), default=1)
    changes = [np.pad(c.changes, ((0, 0), (0, most - c.changes.shape[1]))) for c in corridors]
    return RouteTable(
        number=np.zeros((0, 0), np.int32),
        free=len(free),
        start=row_base,
        lane=joined((c.lane for c in corridors), lane_base[worlds]),
        group=joined((c.group for c in corridors), group_base[:-1]),
        begin=joined(c.begin for c in corridors),
        end=joined(c.end for c in corridors),
        onward_start=np.append(
            joined((c.onward_start[:-1] for c in corridors), onward_base[:-1]), onward_base[-1]
        ),
        onward=joined((c.onward for c in corridors), row_base[:-1]),
        before=joined((c.before for c in corridors), row_base[:-1]),
        by_lane=joined((c.by_lane for c in corridors), row_base[:-1]),
        changes=np.concatenate(changes) if changes else np.zeros((0, most), np.int8),
    )
