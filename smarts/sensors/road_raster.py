"""Maps as pictures: baked once for each atlas, so that drawing a view is looking up its pixels."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from smarts.arrays import Floats, Longs, Pixels
from smarts.geometry.compiling import kernel
from smarts.geometry.raster import cut_view, near_blocks, paint_band, paint_outline
from smarts.roads.atlas import ROAD_LANES, RoadAtlas
from smarts.roads.lane_graph import LaneGraph, LaneKind
from smarts.roads.memory import remembered

ROAD = 1
"""Bit of cells on a lane for motor vehicles, or inside a junction."""
DIVIDER = 2
"""Bit of cells on the (dashed) line between lanes of one direction."""
CENTRE_LINE = 4
"""Bit of cells on the line at the left edge of a road's leftmost lane."""
PATH = 8
"""Bit of cells on sidewalks, bicycle lanes and shoulders."""

_CELL = 0.2
"""Side of a cell [m], about the size of the finest pixels."""
_MOST_CELLS = 40_000_000
_LINE = 0.2
"""Half the width of a line [m]: twice that of real ones, so that no line falls between cells or pixels."""
_DASH = 3.0
"""[m]"""
_PATHS = (LaneKind.BICYCLE, LaneKind.FOOT, LaneKind.SHOULDER)


class RoadRaster(NamedTuple):
    """The pictures of M maps in a row."""

    cells: Pixels
    """Bits of all cells; those of a map by rows from the south, each from the west."""
    first: Longs
    """First cell of each map, shape (M,)."""
    shape: Longs
    """Rows and columns of each map, shape (M, 2)."""
    origin: Floats
    """South-western corner of each map [m], shape (M, 2)."""
    size: Floats
    """Side of each map's cells [m], shape (M,)."""
    near: Pixels
    """The maps' `near_blocks`, flat, one after the other."""
    near_first: Longs
    """First block of each map, shape (M,)."""
    near_shape: Longs
    """Rows and columns of each map's blocks, shape (M, 2)."""


@remembered(most=1)
def road_raster(atlas: RoadAtlas) -> RoadRaster:
    """Return the (remembered) pictures of an atlas's maps."""
    pictures = [_draw(graph) for graph in atlas.graphs]
    return RoadRaster(
        *_in_a_row([picture for picture, _, _ in pictures]),
        np.array([origin for _, origin, _ in pictures]),
        np.array([size for _, _, size in pictures]),
        *_in_a_row([near_blocks(picture) for picture, _, _ in pictures]),
    )


@kernel
def paint_road(
    raster: RoadRaster,
    m: int,
    x: float,
    y: float,
    heading: float,
    resolution: float,
    colours: Pixels,
    view: Pixels,
) -> None:
    """Write the road around a viewer into all pixels of a view.

    Args:
        raster: The maps.
        m: The map.
        x: The viewer's [m].
        y: The viewer's [m].
        heading: The viewer's [rad].
        resolution: Side of a pixel [m].
        colours: Of each combination of a cell's bits, shape (16, channels); 1 or 3 channels.
        view: Written, shape (height, width, channels).
    """
    rows, columns = raster.shape[m, 0], raster.shape[m, 1]
    cells = raster.cells[raster.first[m] : raster.first[m] + rows * columns]
    near_rows, near_columns = raster.near_shape[m, 0], raster.near_shape[m, 1]
    near = raster.near[raster.near_first[m] : raster.near_first[m] + near_rows * near_columns]
    cut_view(
        cells,
        rows,
        columns,
        raster.origin[m, 0],
        raster.origin[m, 1],
        raster.size[m],
        near.reshape(near_rows, near_columns),
        x,
        y,
        heading,
        resolution,
        colours,
        view,
    )


def _in_a_row(pictures: list[Pixels]) -> tuple[Pixels, Longs, Longs]:
    """Return the pixels of all pictures, where each begins, and their shapes."""
    sizes = [picture.size for picture in pictures]
    return (
        np.concatenate([picture.ravel() for picture in pictures]),
        np.cumsum([0, *sizes])[:-1].astype(np.int64),
        np.array([picture.shape for picture in pictures], np.int64),
    )


def _draw(graph: LaneGraph) -> tuple[Pixels, Floats, float]:
    """Return a map's cells, shape (rows, columns), their south-western corner and their size [m]."""
    margin = float(graph.width.max())
    corners = np.concatenate((graph.point_xy, graph.junction_xy))
    origin, extent = corners.min(axis=0) - margin, np.ptp(corners, axis=0) + 2 * margin
    size = max(_CELL, float(np.sqrt(extent.prod() / _MOST_CELLS)))
    columns, rows = (int(count) for count in np.ceil(extent / size))
    cells = np.zeros((rows, columns), np.uint8)
    frame = (cells, float(origin[0]), float(origin[1]), size)
    # The graph's own arrays are read-only, which would be another signature to compile.
    points, vertices = graph.point_xy.copy(), graph.junction_xy.copy()
    for first, last in pairwise(graph.junction_start.tolist()):
        paint_outline(*frame, vertices, first, last, ROAD)
    for lane, kind in enumerate(graph.kind):
        bits = ROAD if kind in ROAD_LANES else PATH if kind in _PATHS else 0
        line = (points, *(int(n) for n in graph.point_start[lane : lane + 2]))
        if bits:
            half = float(graph.width[lane]) / 2
            paint_band(*frame, *line, -half, half, 0.0, bits)
        if bits == ROAD and not graph.is_internal[lane]:
            _draw_marking(graph, lane, (*frame, *line))
    return cells, origin, size


def _draw_marking(graph: LaneGraph, lane: int, line: tuple[Any, ...]) -> None:
    """Draw the line to the left of a lane; the arguments of `paint_band` up to `last` are in `line`."""
    half = float(graph.width[lane]) / 2
    is_leftmost = graph.left[lane] < 0 or graph.kind[graph.left[lane]] not in ROAD_LANES
    dash, marking = (0.0, CENTRE_LINE) if is_leftmost else (_DASH, DIVIDER)
    paint_band(*line, half - _LINE, half + _LINE, dash, marking)
