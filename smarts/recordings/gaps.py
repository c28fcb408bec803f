"""Gaps along paths: to what is on the path ahead of a vehicle; drivers' headways by them."""

from __future__ import annotations

import math

import numpy as np

from smarts.arrays import Floats, Ints
from smarts.geometry.binding import bind
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import segment_at
from smarts.recordings.paths import Paths

SIDE = 0.1
"""Room that a vehicle needs at each side of its path [m]."""
STANDING_GAP = 2.0
"""Gap to a standing leader [m]."""
FARTHEST, LONGEST, SLOWEST = 60.0, 4.0, 1.0
"""A vehicle follows another one that is at most so far [m] and so long [s] ahead, if it is faster [m/s]."""
ALIGNED = 0.5
"""A vehicle follows others whose heading differs by less from its own [rad]."""
LEAST_SAMPLES = 10
"""Headways are known from as many samples on."""
DEFAULT_HEADWAY, LEAST_HEADWAY, MOST_HEADWAY = 1.0, 0.5, 2.0
"""[s]"""


@kernel
def gap_on_path(
    paths: Paths,
    p: int,
    s: float,
    half_length: float,
    half_width: float,
    reach: float,
    pose: tuple[float, float, float],
    half_length2: float,
    half_width2: float,
) -> tuple[float, float]:
    """Return the gap of a vehicle to another one that is on its path, bumper to bumper; infinite if none is.

    Args:
        paths: The paths.
        p: The vehicle's path, which goes straight on behind its last point.
        s: Arc length of its centre [m].
        half_length: Half its length [m].
        half_width: Half its width [m].
        reach: Arc length along which the path is looked at [m].
        pose: Pose of the other vehicle.
        half_length2: Half its length [m].
        half_width2: Half its width [m].

    Returns:
        The gap [m], and the cosine of the angle between the path there and the other vehicle.
    """
    first, end = paths.point[p], paths.point[p + 1]
    point = segment_at(paths.point_s, first, end, s)
    while point < end - 1 and paths.point_s[point] <= s + reach:
        ax, ay = paths.point_x[point], paths.point_y[point]
        length = paths.point_s[point + 1] - paths.point_s[point]
        ux, uy = (paths.point_x[point + 1] - ax) / length, (paths.point_y[point + 1] - ay) / length
        dx, dy = pose[0] - ax, pose[1] - ay
        along, across = dx * ux + dy * uy, abs(dy * ux - dx * uy)
        cosine = math.cos(pose[2]) * ux + math.sin(pose[2]) * uy
        sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
        half_along = half_length2 * abs(cosine) + half_width2 * sine
        half_across = half_length2 * sine + half_width2 * abs(cosine)
        is_last = point == end - 2
        is_here = along + half_along >= 0.0 and (along - half_along <= length or is_last)
        is_ahead = paths.point_s[point] + along > s
        if is_here and is_ahead and across < half_width + SIDE + half_across:
            return float(paths.point_s[point] + along - half_along - s - half_length), float(cosine)
        point += 1
    return np.inf, 1.0


@kernel
def place_at(paths: Paths, p: int, t: float) -> tuple[float, float, float, float, float]:
    """Return x, y [m], heading [rad], speed [m/s] and arc length [m] of a track at a time [s]."""
    row = segment_at(paths.t, paths.sample[p], paths.sample[p + 1], t)
    share = 0.0
    if paths.sample[p + 1] - paths.sample[p] > 1:
        share = (t - paths.t[row]) / (paths.t[row + 1] - paths.t[row])
    share = min(1.0, max(0.0, share))
    following = row + 1 if share > 0.0 else row
    x = paths.x[row] + share * (paths.x[following] - paths.x[row])
    y = paths.y[row] + share * (paths.y[following] - paths.y[row])
    turn = paths.turn[row] + share * (paths.turn[following] - paths.turn[row])
    speed = paths.speed[row] + share * (paths.speed[following] - paths.speed[row])
    s = paths.s[row] + share * (paths.s[following] - paths.s[row])
    return float(x), float(y), float(turn), float(speed), float(s)


@kernel
def _headways(paths: Paths, p: int, others: Ints, found: Floats) -> None:
    """Write the time headway of a track at each of its samples [s], infinite where it follows none."""
    half_length, half_width = 0.5 * paths.length[p], 0.5 * paths.width[p]
    for row in range(paths.sample[p], paths.sample[p + 1]):
        t, speed, nearest = paths.t[row], paths.speed[row], np.inf
        for other in others:
            if other == p or not paths.begin[other] <= t <= paths.end[other] or speed <= SLOWEST:
                continue
            x, y, turn, _, _ = place_at(paths, other, t)
            halves = 0.5 * paths.length[other], 0.5 * paths.width[other]
            if math.hypot(x - paths.x[row], y - paths.y[row]) < FARTHEST + half_length + halves[0]:
                gap, cosine = gap_on_path(
                    paths, p, paths.s[row], half_length, half_width, FARTHEST, (x, y, turn), *halves
                )
                if cosine > math.cos(ALIGNED):
                    nearest = min(nearest, gap)
        found[row - paths.sample[p]] = (nearest - STANDING_GAP) / speed if nearest <= FARTHEST else np.inf


def headways(paths: Paths) -> Floats:
    """Return the time headway of each track's driver [s], shape (T,): the 5th percentile of its samples'."""
    measure, found = bind(_headways, paths), np.full(len(paths.kind), DEFAULT_HEADWAY)
    for p in range(len(found)):
        others = np.flatnonzero((paths.begin <= paths.end[p]) & (paths.end >= paths.begin[p]))
        own = np.empty(paths.sample[p + 1] - paths.sample[p])
        measure(p, others.astype(np.int32), own)
        own = own[own < LONGEST]
        if len(own) >= LEAST_SAMPLES:
            found[p] = np.clip(np.percentile(own, 5), LEAST_HEADWAY, MOST_HEADWAY)
    return found
