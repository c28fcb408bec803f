"""Polylines as arrays of shape (P, 2) with arc lengths: preparation work in plain NumPy."""

from __future__ import annotations

import numpy as np

from smarts.arrays import Floats
from smarts.geometry.frames import wrap_angle

COINCIDENT = 1e-6
"""Vertices closer than this are one vertex [m]."""


def without_repeats(points: Floats) -> Floats:
    """Return the polyline without vertices that coincide with the one before."""
    steps = np.hypot(*np.diff(points, axis=0).T)
    return points[np.concatenate(([True], steps > COINCIDENT))]


def arc_lengths(points: Floats) -> Floats:
    """Return the distance along the polyline of each vertex [m], shape (P,), beginning with 0."""
    return np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))))


def subdivide(points: Floats, spacing: float) -> Floats:
    """Return the same curve with vertices at most `spacing` [m] apart.

    Every original vertex stays, and each of its segments is cut into equal steps; so the curve, its length
    and the distance of any point to it are unchanged.
    """
    steps = np.hypot(*np.diff(points, axis=0).T)
    pieces = np.maximum(1, np.ceil(steps / spacing - 1e-9).astype(np.int64))
    segment = np.repeat(np.arange(len(steps)), pieces)
    first = np.repeat(np.cumsum(pieces) - pieces, pieces)
    share = ((np.arange(len(segment)) - first) / pieces[segment])[:, None]
    start, end = points[segment], points[segment + 1]
    return np.vstack((start + share * (end - start), points[-1:]))


def headings(points: Floats) -> Floats:
    """Return the smoothed heading at each vertex [rad], shape (P,).

    Inner vertices take the direction between the middles of their two segments' unit vectors, so linear
    interpolation between vertices turns without a jump; the two ends take their own segment's direction.
    """
    steps = np.diff(points, axis=0)
    lengths = np.hypot(*steps.T)
    units = steps / np.maximum(lengths, COINCIDENT)[:, None]
    tangents = np.vstack((units[:1], units[:-1] + units[1:], units[-1:]))
    # A vertex at which the line turns back by half a turn has no bisector; it looks ahead.
    undefined = np.hypot(*tangents.T) < 1e-9
    tangents[undefined] = np.vstack((units, units[-1:]))[undefined]
    return wrap_angle(np.arctan2(tangents[:, 1], tangents[:, 0]))
