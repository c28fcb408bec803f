"""Top-down rasters: paints outlines, bands along lines and boxes, and cuts out views.

A view has the viewer at its centre, facing the upper edge: row 0 is the farthest ahead, column 0 the farthest
to the left. A point belongs to the pixel that contains it; a pixel shows the scene at its centre.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Floats
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import cell_number, inside_outline, project

Pixels = NDArray[np.uint8]

BLOCK = 8
"""Side of the blocks of cells whose neighbourhoods `near_blocks` describes [cells]."""
_SMALLEST_TILE = 4
"""Side of the smallest tiles of a view that are worth looking for blocks [pixels]."""


@kernel
def paint_band(
    cells: Pixels,
    origin_x: float,
    origin_y: float,
    size: float,
    points: Floats,
    first: int,
    last: int,
    right: float,
    left: float,
    dash: float,
    bits: int,
) -> None:
    """Set bits in the cells whose centres lie in a band along a polyline.

    Args:
        cells: The raster, rows from south to north, columns from west to east, shape (rows, columns).
        origin_x: x of the lower left corner of cell (0, 0) [m].
        origin_y: y of this corner [m].
        size: Side of a cell [m].
        points: Points of the polylines [m], shape (P, 2).
        first: Index of the polyline's first point.
        last: Index after its last point.
        right: Offset of the band's right edge, positive to the left of the line [m].
        left: Offset of the band's left edge [m].
        dash: Length of dashes and of the gaps between them [m]; 0 for a solid band.
        bits: The bits to set.
    """
    reach = max(abs(right), abs(left))
    gone = 0.0
    for point in range(first, last - 1):
        ax, ay, bx, by = points[point, 0], points[point, 1], points[point + 1, 0], points[point + 1, 1]
        length = math.hypot(bx - ax, by - ay)
        low_row = max(0, cell_number(min(ay, by) - reach, origin_y, size))
        high_row = min(cells.shape[0] - 1, cell_number(max(ay, by) + reach, origin_y, size))
        low_column = max(0, cell_number(min(ax, bx) - reach, origin_x, size))
        high_column = min(cells.shape[1] - 1, cell_number(max(ax, bx) + reach, origin_x, size))
        for row in range(low_row, high_row + 1):
            for column in range(low_column, high_column + 1):
                x, y = origin_x + (column + 0.5) * size, origin_y + (row + 0.5) * size
                share, square, cross = project(x, y, ax, ay, bx, by)
                if share > 1.0 or (share < 0.0 and not _is_in_wedge(points, first, point, x, y)):
                    continue
                offset = math.copysign(math.sqrt(square), cross)
                is_dash = dash == 0.0 or (gone + share * length) % (2.0 * dash) < dash
                if right <= offset <= left and is_dash:
                    cells[row, column] |= bits
        gone += length


@kernel
def _is_in_wedge(points: Floats, first: int, point: int, x: float, y: float) -> bool:
    """Return whether a point before the segment at `point` lies beyond the previous segment's end."""
    if point == first:
        return False
    a, b = points[point - 1], points[point]
    return project(x, y, a[0], a[1], b[0], b[1])[0] > 1.0


@kernel
def paint_outline(
    cells: Pixels,
    origin_x: float,
    origin_y: float,
    size: float,
    vertices: Floats,
    first: int,
    last: int,
    bits: int,
) -> None:
    """Set bits in the cells whose centres lie in the polygon `vertices[first:last]`; see `paint_band`."""
    if first == last:
        return
    low_x, high_x = vertices[first:last, 0].min(), vertices[first:last, 0].max()
    low_y, high_y = vertices[first:last, 1].min(), vertices[first:last, 1].max()
    low_row, low_column = cell_number(low_y, origin_y, size), cell_number(low_x, origin_x, size)
    high_row, high_column = cell_number(high_y, origin_y, size), cell_number(high_x, origin_x, size)
    for row in range(max(0, low_row), min(cells.shape[0] - 1, high_row) + 1):
        for column in range(max(0, low_column), min(cells.shape[1] - 1, high_column) + 1):
            x, y = origin_x + (column + 0.5) * size, origin_y + (row + 0.5) * size
            if inside_outline(x, y, vertices, first, last):
                cells[row, column] |= bits


@kernel
def place_in_view(
    x: float, y: float, viewer_x: float, viewer_y: float, viewer_heading: float
) -> tuple[float, float]:
    """Return the position of a point in a viewer's frame: distance ahead and to the left [m]."""
    cosine, sine = math.cos(viewer_heading), math.sin(viewer_heading)
    dx, dy = x - viewer_x, y - viewer_y
    return dx * cosine + dy * sine, dy * cosine - dx * sine


@kernel
def paint_box(
    view: Pixels,
    resolution: float,
    ahead: float,
    aside: float,
    turn: float,
    length: float,
    width: float,
    colour: Pixels,
) -> None:
    """Paint an oriented box into a view, at least one pixel long and wide.

    Args:
        view: The view, shape (rows, columns, channels).
        resolution: Side of a pixel [m].
        ahead: Position of the box's centre ahead of the viewer [m].
        aside: Its position to the viewer's left [m].
        turn: Heading of the box minus the viewer's heading [rad].
        length: Length of the box [m].
        width: Width of the box [m].
        colour: Colour of the box, shape (channels,).
    """
    rows, columns, channels = view.shape
    half_length, half_width = 0.5 * max(length, resolution), 0.5 * max(width, resolution)
    cosine, sine = math.cos(turn), math.sin(turn)
    reach_ahead = abs(cosine) * half_length + abs(sine) * half_width
    reach_aside = abs(sine) * half_length + abs(cosine) * half_width
    # This comparison skips boxes at NaN, and far ones, whose indices would overflow.
    in_view = (
        abs(ahead) <= 0.5 * rows * resolution + reach_ahead
        and abs(aside) <= 0.5 * columns * resolution + reach_aside
    )
    if not in_view:
        return
    top = max(0, math.floor(0.5 * rows - (ahead + reach_ahead) / resolution))
    bottom = min(rows - 1, math.floor(0.5 * rows - (ahead - reach_ahead) / resolution))
    leftmost = max(0, math.floor(0.5 * columns - (aside + reach_aside) / resolution))
    rightmost = min(columns - 1, math.floor(0.5 * columns - (aside - reach_aside) / resolution))
    for row in range(top, bottom + 1):
        forward = (0.5 * rows - row - 0.5) * resolution - ahead
        along, across = forward * cosine, forward * sine
        # A box covers a row without gaps: find the ends and fill the pixels between them.
        begin, end = leftmost, rightmost
        while begin <= end:
            left = (0.5 * columns - begin - 0.5) * resolution - aside
            if abs(along + left * sine) <= half_length and abs(left * cosine - across) <= half_width:
                break
            begin += 1
        while end > begin:
            left = (0.5 * columns - end - 0.5) * resolution - aside
            if abs(along + left * sine) <= half_length and abs(left * cosine - across) <= half_width:
                break
            end -= 1
        for column in range(begin, end + 1):
            for channel in range(channels):
                view[row, column, channel] = colour[channel]


@kernel
def _within(start: float, step: float, limit: int, begin: int, end: int) -> tuple[int, int]:
    """Return a range within [begin, end] that holds all c with 0 <= start + step * c <= limit."""
    if step == 0.0:
        return (begin, end) if -1.0 <= start <= limit + 1.0 else (begin, begin)
    one, other = -start / step, (limit - start) / step
    first = min(max(min(one, other) - 1.0, begin), end)
    last = min(max(max(one, other) + 2.0, begin), end)
    return math.floor(first), math.ceil(last)


def near_blocks(cells: Pixels) -> Pixels:
    """Return for each block of a raster whether it or a block that touches it has a cell other than 0.

    Args:
        cells: Shape (rows, columns).

    Returns:
        Shape (rows / BLOCK + 2, columns / BLOCK + 2), rounded up: with a ring of blocks around the raster.
    """
    rows, columns = (-(-side // BLOCK) for side in cells.shape)
    filled = np.zeros((rows * BLOCK, columns * BLOCK), np.bool_)
    filled[: cells.shape[0], : cells.shape[1]] = cells != 0
    taken = np.zeros((rows + 4, columns + 4), np.bool_)
    taken[2:-2, 2:-2] = filled.reshape(rows, BLOCK, columns, BLOCK).any(axis=(1, 3))
    near = np.zeros((rows + 2, columns + 2), np.uint8)
    for down in range(3):
        for along in range(3):
            near |= taken[down : down + rows + 2, along : along + columns + 2]
    return near


@kernel
def _row_of_tiles(
    near: Pixels, tile: int, width: int, column: float, row: float, sine: float, cosine: float
) -> tuple[int, int]:
    """Return the pixels of some rows of a view that may show a cell other than 0: first, and after the last.

    Args:
        near: Result of `near_blocks` for the raster.
        tile: How many rows there are, and how many pixels are looked at together.
        width: Width of the view [pixels].
        column: Column of the raster [cells], in the middle of the view and of the rows.
        row: The same.
        sine: Sine of the view's heading, times the side of a pixel [cells].
        cosine: The same.
    """
    begin, end = width, 0
    for first in range(0, width, tile):
        left = 0.5 * width - first - 0.5 * tile
        at_row = math.floor((row + left * cosine) / BLOCK) + 1
        at_column = math.floor((column - left * sine) / BLOCK) + 1
        if 0 <= at_row < near.shape[0] and 0 <= at_column < near.shape[1] and near[at_row, at_column]:
            begin, end = min(begin, first), min(first + tile, width)
    return begin, max(begin, end)


@kernel
def _is_inside(column: float, row: float, columns: int, rows: int) -> bool:
    return 0.0 <= column < columns and 0.0 <= row < rows


@kernel
def cut_view(
    cells: Pixels,
    rows: int,
    columns: int,
    origin_x: float,
    origin_y: float,
    size: float,
    near: Pixels,
    x: float,
    y: float,
    heading: float,
    resolution: float,
    colours: Pixels,
    view: Pixels,
) -> None:
    """Write to each pixel of a view the colour of the raster cell at its centre, `colours[0]` outside.

    Tiles of pixels around which all cells are 0 are not looked up one by one.

    Args:
        cells: The raster, rows from south to north, columns from west to east, shape (rows * columns,).
        rows: Rows of the raster.
        columns: Columns of the raster.
        origin_x: x of the lower left corner of cell (0, 0) [m].
        origin_y: y of this corner [m].
        size: Side of a cell [m].
        near: The result of `near_blocks`.
        x: x of the viewer [m].
        y: y of the viewer [m].
        heading: Heading of the viewer [rad].
        resolution: Side of a pixel [m].
        colours: Colour of each cell value, shape (values, channels); 1 or 3 channels.
        view: The view, written, shape (height, width, channels).
    """
    height, width, channels = view.shape
    cosine, sine = math.cos(heading) * resolution / size, math.sin(heading) * resolution / size
    middle_column, middle_row = (x - origin_x) / size, (y - origin_y) / size
    left, cell = 0.5 * width - 0.5 - np.arange(width), np.empty(width, np.int32)
    west, north = left * sine, left * cosine
    # No centre of a pixel is farther than a block from the middle of its tile.
    tile = int(min(1.4 * (BLOCK - 0.5) * size / resolution, max(height, width)))
    low, high = 0, width
    for r in range(height):
        if tile >= _SMALLEST_TILE and r % tile == 0:
            ahead = 0.5 * height - r - 0.5 * tile
            across, along = middle_column + ahead * cosine, middle_row + ahead * sine
            low, high = _row_of_tiles(near, tile, width, across, along, sine, cosine)
        ahead = 0.5 * height - r - 0.5
        across, along = middle_column + ahead * cosine, middle_row + ahead * sine
        # The pixels of a row inside the raster are contiguous: estimate the ends, then find them by trial.
        begin, end = _within(across - west[0], sine, columns, low, high)
        begin, end = _within(along + north[0], -cosine, rows, begin, end)
        while begin < end and not _is_inside(across - west[begin], along + north[begin], columns, rows):
            begin += 1
        while end > begin and not _is_inside(across - west[end - 1], along + north[end - 1], columns, rows):
            end -= 1
        # A loop apart from the look-up, so that the compiler vectorises it.
        for c in range(begin, end):
            cell[c] = np.int32(np.floor(along + north[c]) * columns + np.floor(across - west[c]))
        line = view[r]
        for channel in range(channels):
            line[:begin, channel], line[end:, channel] = colours[0, channel], colours[0, channel]
        # An unsigned index: a signed one would need a test for negative values.
        if channels == 3:
            for c in range(begin, end):
                value = cells[np.uint32(cell[c])]
                line[c, 0], line[c, 1], line[c, 2] = colours[value, 0], colours[value, 1], colours[value, 2]
        else:
            for c in range(begin, end):
                line[c, 0] = colours[cells[np.uint32(cell[c])], 0]
