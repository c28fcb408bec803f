"""Curves out of one lane and into another, as cubic Bezier curves; compiled."""

from __future__ import annotations

import math

import numpy as np

from smarts.arrays import Floats
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import project, segment_at, wrapped
from smarts.roads.arrays import Roads
from smarts.roads.kernels import pose_on_lane

PIECES = 64
"""Chords by which lengths along a curve are measured."""


@kernel
def curve_into(roads: Roads, begin: Floats, lane: int, s: float) -> Floats:
    """Return the four control points [m] of a curve that leaves a pose and enters a lane, shape (4, 2).

    Its handles are those of the circular arc that turns by as much over the same chord; for no turn at all
    that is a third of the chord, which makes the S of a lane change.

    Args:
        roads: The maps' lanes.
        begin: x, y [m] and heading [rad].
        lane: Numbered across all maps.
        s: Where on its centreline the curve ends [m].
    """
    x, y, heading = pose_on_lane(roads, lane, s)
    return curve_between(begin, x, y, heading, 1.0)


@kernel
def curve_between(begin: Floats, x: float, y: float, heading: float, longer: float) -> Floats:
    """Return the control points of a curve from a pose to another, its handles `longer` than an arc's."""
    turn = abs(wrapped(heading - begin[2]))
    handle = longer * math.hypot(x - begin[0], y - begin[1]) / 3.0
    if turn > 1e-3:
        handle *= 2.0 * math.tan(0.25 * turn) / math.sin(0.5 * turn)
    control = np.empty((4, 2))
    # One number at a time: numba compiles the assignment of a row with the texts of errors in its shape.
    control[0, 0], control[0, 1] = begin[0], begin[1]
    control[1, 0] = begin[0] + handle * math.cos(begin[2])
    control[1, 1] = begin[1] + handle * math.sin(begin[2])
    control[2, 0], control[2, 1] = x - handle * math.cos(heading), y - handle * math.sin(heading)
    control[3, 0], control[3, 1] = x, y
    return control


@kernel
def pose_on(control: Floats, u: float) -> tuple[float, float, float]:
    """Return x, y [m] and heading [rad] at parameter u in [0, 1] of a curve."""
    v = 1.0 - u
    point = v * v * v * control[0] + 3.0 * u * v * (v * control[1] + u * control[2]) + u * u * u * control[3]
    along = v * v * (control[1] - control[0]) + 2.0 * u * v * (control[2] - control[1])
    along += u * u * (control[3] - control[2])
    return point[0], point[1], math.atan2(along[1], along[0])


@kernel
def stations_of(control: Floats) -> Floats:
    """Return the length of a curve from its begin to u = i / `PIECES` [m], shape (PIECES + 1,)."""
    stations = np.zeros(PIECES + 1)
    x, y, _ = pose_on(control, 0.0)
    for i in range(1, PIECES + 1):
        was_x, was_y = x, y
        x, y, _ = pose_on(control, i / PIECES)
        stations[i] = stations[i - 1] + math.hypot(x - was_x, y - was_y)
    return stations


@kernel
def station_near(control: Floats, stations: Floats, x: float, y: float) -> tuple[float, float]:
    """Return how far along a curve the point of it nearest to a position is, and how far off that is [m].

    The curve is extended straight beyond its end, so the result can exceed its length.
    """
    best_square, best = np.inf, 0.0
    a_x, a_y, _ = pose_on(control, 0.0)
    for i in range(PIECES):
        b_x, b_y, _ = pose_on(control, (i + 1) / PIECES)
        share, square, _ = project(x, y, a_x, a_y, b_x, b_y)
        if square < best_square:
            share = max(share, 0.0) if i == PIECES - 1 else min(max(share, 0.0), 1.0)
            best_square, best = square, stations[i] + share * (stations[i + 1] - stations[i])
        a_x, a_y = b_x, b_y
    return best, math.sqrt(best_square)


@kernel
def pose_along(control: Floats, stations: Floats, station: float) -> tuple[float, float, float]:
    """Return x, y [m] and heading [rad] at a distance from the begin of a curve [m], at most at its end."""
    i = segment_at(stations, 0, len(stations), station)
    share = (station - stations[i]) / (stations[i + 1] - stations[i])
    return pose_on(control, (i + min(max(share, 0.0), 1.0)) / PIECES)


@kernel
def bends_of(control: Floats, stations: Floats) -> Floats:
    """Return the curvature of a curve at u = i / `PIECES` [1/m], without sign, shape (PIECES + 1,).

    Each is the larger one of the two chords that meet there.
    """
    bends = np.zeros(PIECES + 1)
    _, _, was = pose_on(control, 0.0)
    for i in range(PIECES):
        _, _, heading = pose_on(control, (i + 1) / PIECES)
        bend = abs(wrapped(heading - was)) / max(stations[i + 1] - stations[i], 1e-9)
        bends[i], bends[i + 1] = max(bends[i], bend), bend
        was = heading
    return bends


@kernel
def sharpest_bend(control: Floats, stations: Floats) -> float:
    """Return the largest curvature of a curve [1/m]."""
    return bends_of(control, stations).max()
