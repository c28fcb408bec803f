"""Paths as rows of time, x, y, heading, speed: their poses at given times."""

from __future__ import annotations

import math

import numpy as np

from smarts.arrays import Floats
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import wrapped
from smarts.geometry.timed_paths import pose_at

STANDING = 0.01
"""A path that moves by less between two rows has no tangent there [m]."""


@kernel
def resample(paths: Floats, times: Floats) -> Floats:
    """Return paths at other times, as the controller of `TrajectoryWithTime` reads them; see `pose_at`.

    Args:
        paths: Rows of time [s], x, y [m], heading [rad], speed [m/s], shape (M, P, 5).
        times: In seconds, shape (M, T).

    Returns:
        The rows at these times, with headings in (-pi, pi], shape (M, T, 5).
    """
    count = paths.shape[1]
    found = np.empty((len(paths), times.shape[1], 5))
    for m in range(len(paths)):
        for t in range(times.shape[1]):
            found[m, t, 0] = times[m, t]
            pose_at(paths[m], count, times[m, t], found[m, t, 1:])
    return found


def as_actions(path: Floats, points: int, *, with_time: bool = True) -> Floats:
    """Return paths as a batch of actions `TrajectoryWithTime` (or `Trajectory`), shape (N, 5 or 4, points).

    The last row is repeated up to the number of points. The headings of a path are the vehicle's, which is
    placed there. Without times they become those of the path's tangents, along which the controller steers:
    in the sharpest bends a vehicle's heading is 0.3 rad inwards of the way of its centre.

    Args:
        path: The paths, shape (N, P, 5), P <= points.
        points: Points of an action; `smarts.controllers.action_formats.PATH_POINTS` in the environments.
        with_time: Whether the actions hold times.
    """
    if not with_time:
        path = np.concatenate([path[..., :3], _tangents(path)[..., None], path[..., 4:]], axis=2)
    padded = np.pad(path, ((0, 0), (0, points - path.shape[1]), (0, 0)), mode="edge")
    return padded.transpose(0, 2, 1)[:, 0 if with_time else 1 :]


@kernel
def _tangents(paths: Floats) -> Floats:
    """Return the headings of the circles through each point and those beside it, shape (N, P).

    Where a path stands they are the last ones before, or the given headings.
    """
    count = paths.shape[1]
    found, chords, spans = np.copy(paths[:, :, 3]), np.empty(count), np.zeros(count)
    for m in range(len(paths) if count > 1 else 0):
        path, headings = paths[m], found[m]
        chord = path[0, 3]
        # Chord i leads from the point before to point i.
        for i in range(1, count):
            dx, dy = path[i, 1] - path[i - 1, 1], path[i, 2] - path[i - 1, 2]
            span = math.hypot(dx, dy)
            spans[i] = span if span > STANDING else 0.0
            chord = math.atan2(dy, dx) if span > STANDING else chord
            chords[i] = chord
        for i in range(1, count - 1):
            both = spans[i] + spans[i + 1]
            share = spans[i] / both if both > 0.0 else 0.0
            headings[i] = chords[i] + share * wrapped(chords[i + 1] - chords[i])
        first, last = chords[1], chords[count - 1]
        headings[0] = first - (wrapped(headings[1] - first) if count > 2 else 0.0)
        headings[count - 1] = last + (wrapped(last - headings[count - 2]) if count > 2 else 0.0)
    return found
