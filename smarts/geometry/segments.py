"""Kernels for angles, single segments and outlines."""

from __future__ import annotations

import math

from smarts.arrays import Floats
from smarts.geometry.compiling import kernel


@kernel
def project(x: float, y: float, ax: float, ay: float, bx: float, by: float) -> tuple[float, float, float]:
    """Project a point onto the segment from a to b.

    Returns:
        The position of the projection along the segment, not clipped (0 at a, 1 at b); the squared distance
        to the segment [m^2]; the cross product of direction and offset, positive to the left [m^2].
    """
    dx, dy = bx - ax, by - ay
    px, py = x - ax, y - ay
    square = dx * dx + dy * dy
    share = (px * dx + py * dy) / square if square > 0.0 else 0.0
    clipped = min(1.0, max(0.0, share))
    ex, ey = px - clipped * dx, py - clipped * dy
    return share, ex * ex + ey * ey, dx * py - dy * px


@kernel
def inside_outline(x: float, y: float, outline: Floats, first: int, last: int) -> bool:
    """Return whether a point lies in the polygon `outline[first:last]`, by the even-odd rule."""
    inside = False
    before = last - 1
    for vertex in range(first, last):
        ax, ay = outline[vertex, 0], outline[vertex, 1]
        bx, by = outline[before, 0], outline[before, 1]
        if (ay > y) != (by > y) and x < (bx - ax) * (y - ay) / (by - ay) + ax:
            inside = not inside
        before = vertex
    return inside


@kernel
def wrapped_half_open(angle: float) -> float:
    """Return the equivalent angle in (-pi, pi] [rad]: `frames.wrap_angle` for kernels."""
    return math.pi - (math.pi - angle) % (2.0 * math.pi)


@kernel
def wrapped(angle: float) -> float:
    """Return the equivalent angle in [-pi, pi] [rad].

    Unlike `wrapped_half_open`, this returns angles inside the interval bit-identically.
    """
    return angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)


@kernel
def interpolate_angle(a: float, b: float, share: float) -> float:
    """Interpolate from a to b along the shorter turn; angles are in (-pi, pi] [rad], `share` in [0, 1]."""
    # Both sums stay within one turn of the interval, and a comparison is several times faster than a modulo.
    turn = b - a
    if turn > math.pi:
        turn -= 2.0 * math.pi
    elif turn <= -math.pi:
        turn += 2.0 * math.pi
    angle = a + share * turn
    if angle > math.pi:
        angle -= 2.0 * math.pi
    elif angle <= -math.pi:
        angle += 2.0 * math.pi
    return angle


@kernel
def segment_at(stations: Floats, first: int, last: int, s: float) -> int:
    """Return the segment at arc length `s` of the polyline of points `first` to `last - 1`.

    A segment has the index of its first point. Beyond the ends, the first or the last segment is returned.

    Args:
        stations: Arc lengths of all polylines' points [m], shape (P,).
        first: Index of the polyline's first point.
        last: Index after its last point.
        s: Arc length [m].
    """
    low, high = first, last - 2
    while low < high:
        middle = (low + high + 1) // 2
        if stations[middle] <= s:
            low = middle
        else:
            high = middle - 1
    return low


@kernel
def cell_number(value: float, origin: float, size: float) -> int:
    """Return the index of the cell of width `size` that contains a coordinate; it may be negative."""
    return math.floor((value - origin) / size)
