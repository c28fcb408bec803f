"""Polylines as arrays of shape (P, 2) [m], in plain NumPy."""

from __future__ import annotations

import numpy as np

from smarts.arrays import Floats
from smarts.geometry.frames import wrap_angle

COINCIDENT = 1e-6
"""Vertices closer than this coincide [m]."""


def segment_lengths(points: Floats) -> Floats:
    """Return the length of each segment [m], shape (P - 1,)."""
    return np.hypot(*np.diff(points, axis=0).T)


def without_repeats(points: Floats) -> Floats:
    """Return the polyline without vertices that coincide with their predecessor."""
    return points[np.concatenate(([True], segment_lengths(points) > COINCIDENT))]


def arc_lengths(points: Floats) -> Floats:
    """Return the arc length at each vertex [m], shape (P,), beginning with 0."""
    return np.concatenate(([0.0], np.cumsum(segment_lengths(points))))


def subdivide(points: Floats, spacing: float) -> Floats:
    """Return the same curve with vertices at most `spacing` [m] apart.

    Original vertices stay, and each segment is cut into equal steps, so the curve and its length are
    unchanged.
    """
    steps = segment_lengths(points)
    pieces = np.maximum(1, np.ceil(steps / spacing - 1e-9).astype(np.int64))
    segment = np.repeat(np.arange(len(steps)), pieces)
    first = np.repeat(np.cumsum(pieces) - pieces, pieces)
    share = ((np.arange(len(segment)) - first) / pieces[segment])[:, None]
    start, end = points[segment], points[segment + 1]
    return np.vstack((start + share * (end - start), points[-1:]))


def headings(points: Floats) -> Floats:
    """Return the smoothed heading at each vertex [rad], shape (P,).

    The heading of an inner vertex bisects the directions of its two segments, so that linear interpolation
    between vertices is continuous. The first and the last vertex take the direction of their segment.
    """
    steps = np.diff(points, axis=0)
    lengths = np.hypot(*steps.T)
    units = steps / np.maximum(lengths, COINCIDENT)[:, None]
    tangents = np.vstack((units[:1], units[:-1] + units[1:], units[-1:]))
    # A vertex at which the line reverses has no bisector: use the next segment's direction.
    undefined = np.hypot(*tangents.T) < 1e-9
    tangents[undefined] = np.vstack((units, units[-1:]))[undefined]
    return wrap_angle(np.arctan2(tangents[:, 1], tangents[:, 0]))
