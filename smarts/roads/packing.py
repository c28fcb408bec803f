"""Maps and routes packed for the kernels: the arrays of several lane graphs and corridors in a row."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Ints
from smarts.geometry.grid import Grid, build_grid
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.corridors import Corridor
from smarts.roads.lane_graph import LaneGraph

_CELL = 6.0
"""Side of a grid cell [m]; a lane's width or two, so that a cell lists few lanes."""
_MOST_CELLS = 2_000_000
_MOST_CELLS_ACROSS = 8
"""Cells that a lane's surroundings, its width to either side, are across at most, on the whole."""


def pack_roads(graphs: Sequence[LaneGraph]) -> Roads:
    """Return the lanes of all graphs in a row, and a grid over each; the atlas adds `lane_twin`."""
    grids = [_grid(graph) for graph in graphs]
    lane_base = _bases(len(graph.lane_ids) for graph in graphs)
    point_base = _bases(len(graph.point_s) for graph in graphs)
    edge_base = _bases(len(graph.edge_ids) for graph in graphs)
    shifts = np.stack((lane_base, point_base, point_base), axis=1)

    def joined(name: str, parts: Sequence[Any] = graphs) -> NDArray:
        """Return one array of all graphs, or grids, in a row."""
        return np.concatenate([getattr(part, name) for part in parts])

    def stacked(name: str, parts: Sequence[Any] = graphs) -> Ints:
        """Return one CSR of all, in which the numbers of each continue those of the one before."""
        counts = np.concatenate([np.diff(getattr(part, name)) for part in parts])
        return np.concatenate(([0], np.cumsum(counts))).astype(np.int32)

    def raised(name: str, bases: NDArray, parts: Sequence[Any] = graphs) -> Ints:
        """Return one array of all, each one's numbers raised by its base; -1 stays."""
        return _raised((getattr(part, name) for part in parts), bases).astype(np.int32)

    return Roads(
        lane_base=lane_base,
        lane_index=joined("lane_index"),
        lane_width=joined("width"),
        lane_speed=joined("speed_limit"),
        lane_kind=joined("kind"),
        lane_inside=joined("is_internal"),
        lane_edge=raised("lane_edge", edge_base),
        edge_base=edge_base,
        lane_junction=joined("lane_junction").astype(np.int32),
        lane_left=raised("left", lane_base),
        lane_right=raised("right", lane_base),
        lane_twin=np.full(lane_base[-1], -1, np.int32),
        lane_dead_end=np.diff(stacked("successor_start")) == 0,
        conflict_start=stacked("conflict_start"),
        conflict_lane=raised("conflict_lane", lane_base),
        conflict_kind=joined("conflict_kind"),
        conflict_yields=joined("conflict_yields"),
        conflict_extent=joined("conflict_extent"),
        conflict_other_extent=joined("conflict_other_extent"),
        point_start=stacked("point_start"),
        point_xy=joined("point_xy"),
        point_z=joined("point_z"),
        point_heading=joined("point_heading"),
        point_s=joined("point_s"),
        grid_origin=np.array([grid.origin for grid in grids]),
        grid_size=np.array([grid.size for grid in grids]),
        grid_shape=np.array([(grid.columns, grid.rows) for grid in grids], np.int32),
        cell_base=_bases(grid.columns * grid.rows for grid in grids),
        run_start=stacked("run_start", grids),
        run=raised("run", shifts, grids),
        outline_start=stacked("outline_start", grids),
        outline=raised("outline", _bases(len(graph.junction_ids) for graph in graphs), grids),
        vertex_start=stacked("junction_start"),
        vertex=joined("junction_xy"),
        outline_z=joined("junction_z"),
    )


def _grid(graph: LaneGraph) -> Grid:
    extent = np.ptp(graph.point_xy, axis=0) + 2 * graph.width.max()
    # Cells grow where lanes are so wide that each would be listed in a great many.
    reach = float(np.sqrt(np.square(np.repeat(graph.width, np.diff(graph.point_start))).mean()))
    size = max(_CELL, float(np.sqrt(extent[0] * extent[1] / _MOST_CELLS)), 2.0 * reach / _MOST_CELLS_ACROSS)
    # The graph's own arrays are read-only, which would be another signature to compile.
    return build_grid(
        np.array(graph.point_start),
        np.array(graph.point_xy),
        # A lane inside a junction counts up to its whole width to either side, see `kernels.locate`.
        np.array(graph.width),
        np.array(graph.junction_start),
        np.array(graph.junction_xy),
        size,
    )


def _bases(counts: Iterable[int]) -> Ints:
    """Return where each of several parts begins that lie in a row, and where the last ends."""
    return np.cumsum([0, *counts]).astype(np.int32)


def _raised(parts: Iterable[NDArray], bases: NDArray) -> NDArray:
    """Join arrays of numbers, each raised by its base; -1 stays, since it means none."""
    parts = [*parts]
    whole, sizes = np.concatenate(parts), [len(part) for part in parts]
    return np.where(whole < 0, whole, whole + np.repeat(bases[: len(parts)], sizes, axis=0))


def pack_routes(
    free: Sequence[tuple[int, Corridor]], own: Sequence[tuple[int, Corridor]], lane_base: Ints
) -> RouteTable:
    """Return a table of corridors with the numbers of their maps: those without a route, then the routes."""
    worlds = [world for world, _ in (*free, *own)]
    corridors = [corridor for _, corridor in (*free, *own)]
    row_base = _bases(len(corridor.lane) for corridor in corridors)
    onward_base = _bases(len(corridor.onward) for corridor in corridors)
    group_base = _bases(int(corridor.group.max(initial=-1)) + 1 for corridor in corridors)

    def raised(name: str, bases: Ints) -> NDArray:
        return _raised((getattr(corridor, name) for corridor in corridors), bases)

    most = max((corridor.changes.shape[1] for corridor in corridors), default=1)
    changes = np.zeros((row_base[-1], most), np.int8)
    for first, corridor in zip(row_base.tolist(), corridors, strict=False):
        changes[first : first + len(corridor.lane), : corridor.changes.shape[1]] = corridor.changes
    onward_start = _raised((corridor.onward_start[:-1] for corridor in corridors), onward_base)
    return RouteTable(
        number=np.zeros((0, 0), np.int32),
        free=len(free),
        start=row_base,
        lane=raised("lane", lane_base[worlds]),
        group=raised("group", group_base),
        begin=np.concatenate([corridor.begin for corridor in corridors]),
        end=np.concatenate([corridor.end for corridor in corridors]),
        onward_start=np.append(onward_start, onward_base[-1]),
        onward=raised("onward", row_base),
        before=raised("before", row_base),
        by_lane=raised("by_lane", row_base),
        changes=changes,
    )
