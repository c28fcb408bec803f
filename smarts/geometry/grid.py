"""A spatial grid over polylines and outlines.

Each square cell lists runs (line, first point, last point): the parts of lines that come within the line's
reach of the cell. The cell of a point therefore lists every line that has the point within its reach.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from smarts.arrays import Floats, Ints
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import cell_number


class Grid(NamedTuple):
    """Square cells over a bounding box; cell (column, row) has number `row * columns + column`."""

    origin: Floats
    """Lower left corner of cell (0, 0) [m], shape (2,)."""
    size: float
    """Side of a cell [m]."""
    columns: int
    rows: int
    run_start: Ints
    """CSR offsets of each cell's runs, shape (cells + 1,)."""
    run: Ints
    """Rows (line, first point, last point), shape (runs, 3); lines in ascending order within a cell."""
    outline_start: Ints
    """CSR offsets of each cell's outlines, shape (cells + 1,)."""
    outline: Ints
    """Indices of the outlines whose bounding box touches the cell, shape (entries,)."""


def build_grid(
    line_start: Ints, points: Floats, reach: Floats, outline_start: Ints, outlines: Floats, size: float
) -> Grid:
    """Return the grid of polylines and outlines, both in CSR form.

    Args:
        line_start: CSR offsets of the lines' points, shape (L + 1,).
        points: Points of all lines [m], shape (P, 2).
        reach: Distance from each line within which cells list it [m], shape (L,).
        outline_start: CSR offsets of the outlines' vertices, shape (J + 1,).
        outlines: Vertices of all outlines [m], shape (V, 2).
        size: Side of a cell [m].
    """
    margin = float(reach.max(initial=0.0))
    corners = np.concatenate((points, outlines))
    origin = corners.min(axis=0) - margin
    columns, rows = (int(n) for n in (corners.max(axis=0) + margin - origin) // size + 1)
    runs = _count_then_fill(_list_runs, columns * rows, (line_start, points, reach, origin, size, columns), 3)
    boxes = _count_then_fill(
        _list_outlines, columns * rows, (outline_start, outlines, origin, size, columns), 1
    )
    return Grid(origin, size, columns, rows, *runs, boxes[0], boxes[1][:, 0].copy())


def _count_then_fill(listing: Callable, cells: int, arguments: tuple, width: int) -> tuple[Ints, Ints]:
    """Run a listing kernel twice: first count each cell's entries, then write them."""
    start = np.zeros(cells + 1, np.int32)
    listing(*arguments, start[1:], np.empty((0, width), np.int32))
    np.cumsum(start, out=start)
    entries = np.empty((int(start[-1]), width), np.int32)
    listing(*arguments, start[:-1].copy(), entries)
    return start, entries


@kernel
def _list_runs(
    line_start: Ints,
    points: Floats,
    reach: Floats,
    origin: Floats,
    size: float,
    columns: int,
    cursor: Ints,
    entries: Ints,
) -> None:
    """Count each cell's runs in `cursor` if `entries` is empty; else write them at `cursor`."""
    cells = len(cursor)
    open_line = np.full(cells, -1, np.int32)
    open_point = np.full(cells, -1, np.int32)
    for line in range(len(line_start) - 1):
        for point in range(line_start[line], line_start[line + 1] - 1):
            ax, ay, bx, by = points[point, 0], points[point, 1], points[point + 1, 0], points[point + 1, 1]
            left = cell_number(min(ax, bx) - reach[line], origin[0], size)
            right = cell_number(max(ax, bx) + reach[line], origin[0], size)
            low = cell_number(min(ay, by) - reach[line], origin[1], size)
            high = cell_number(max(ay, by) + reach[line], origin[1], size)
            for row in range(low, high + 1):
                for column in range(left, right + 1):
                    cell = row * columns + column
                    if open_line[cell] == line and open_point[cell] == point:
                        if len(entries):
                            entries[cursor[cell] - 1, 2] = point + 1
                    else:
                        if len(entries):
                            entries[cursor[cell], 0] = line
                            entries[cursor[cell], 1] = point
                            entries[cursor[cell], 2] = point + 1
                        cursor[cell] += 1
                    open_line[cell] = line
                    open_point[cell] = point + 1


@kernel
def _list_outlines(
    outline_start: Ints,
    outlines: Floats,
    origin: Floats,
    size: float,
    columns: int,
    cursor: Ints,
    entries: Ints,
) -> None:
    """Count each cell's outlines in `cursor` if `entries` is empty; else write them at `cursor`."""
    for outline in range(len(outline_start) - 1):
        vertices = outlines[outline_start[outline] : outline_start[outline + 1]]
        if len(vertices) == 0:
            continue
        left = cell_number(vertices[:, 0].min(), origin[0], size)
        right = cell_number(vertices[:, 0].max(), origin[0], size)
        low = cell_number(vertices[:, 1].min(), origin[1], size)
        high = cell_number(vertices[:, 1].max(), origin[1], size)
        for row in range(low, high + 1):
            for column in range(left, right + 1):
                cell = row * columns + column
                if len(entries):
                    entries[cursor[cell], 0] = outline
                cursor[cell] += 1
