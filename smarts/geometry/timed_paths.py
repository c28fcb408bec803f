"""Paths whose points have times: where and how fast one is at a time."""

from __future__ import annotations

import math

from smarts.arrays import Floats
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import interpolate_angle, wrapped_half_open


@kernel
def pose_at(path: Floats, count: int, now: float, pose: Floats) -> None:
    """Write x, y, heading, speed of a path at a time.

    Between two points poses and speeds are interpolated linearly. Before the first point they are those of
    the first one; after the last one the way continues straight at the last speed.

    Args:
        path: Rows of time [s], x, y [m], heading [rad], speed [m/s]; only the first `count` are read.
        count: Number of points.
        now: The time [s].
        pose: x, y, heading in (-pi, pi] and speed, written, shape (4,).
    """
    last = path[count - 1]
    if now >= last[0]:
        way = (now - last[0]) * last[4]
        pose[0], pose[1] = last[1] + way * math.cos(last[3]), last[2] + way * math.sin(last[3])
        pose[2], pose[3] = wrapped_half_open(last[3]), last[4]
        return
    i = 0
    while i < count - 2 and path[i + 1, 0] <= now:
        i += 1
    a, b = path[i], path[min(i + 1, count - 1)]
    share = min(max((now - a[0]) / max(b[0] - a[0], 1e-9), 0.0), 1.0)
    pose[0], pose[1] = a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2])
    pose[2] = interpolate_angle(wrapped_half_open(a[3]), wrapped_half_open(b[3]), share)
    pose[3] = a[4] + share * (b[4] - a[4])
