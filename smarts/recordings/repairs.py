"""What can be proved wrong in a recording, and put right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from smarts.arrays import Floats
from smarts.geometry.frames import wrap_angle
from smarts.recordings.tracks import Tracks

MOVING = 2.0
"""Slower vehicles prove nothing [m/s]."""
LEAST_TURN, WIDEST_BAND = np.radians(0.5), np.radians(1.0)
"""Headings are turned if their median angle to the direction of travel is larger than the first, and the
angles between their 5th and 95th percentile spread less than the second [rad]."""
SHORT, AGREES = 0.85, 0.1
"""The first sample's time is wrong if the way to the second is below this share of what the speeds say, while
the next interval agrees with them up to the second share."""


def repaired(tracks: Tracks) -> tuple[Tracks, list[str]]:
    """Return a recording with two faults put right, and a sentence on each that there was.

    Headings that are all turned by the same small angle against the direction of travel, as after positions
    were projected to another grid and headings were not, are turned back. A first sample whose position is
    right but whose time was rounded, so that the vehicle seems to enter slowly and leap to its speed, gets
    the time at which the vehicle was there by its speed.
    """
    said = []
    angle = _turned(tracks)
    if angle:
        tracks = replace(tracks, heading=wrap_angle(tracks.heading - angle))
        said.append(
            f"all headings were turned by {np.degrees(angle):+.2f} degrees against the direction of travel, "
            "and are turned back"
        )
    apart = tracks.apart()
    late = [_true_first_time(each.samples) for each in apart]
    count = sum(first > each.samples[0, 0] for first, each in zip(late, apart, strict=True))
    if count:
        for first, each in zip(late, apart, strict=True):
            each.samples[0, 0] = first
        tracks = Tracks.of(apart, tracks.facts, tracks.signals)
        said.append(
            f"the first samples of {count} of {len(apart)} tracks had times at which, by their speeds, the "
            "vehicles were not there yet, and get the right ones"
        )
    return tracks, said


def _turned(tracks: Tracks) -> float:
    """Return the angle of headings to the direction of travel [rad], if it is one and the same; else 0."""
    same = tracks.track[1:] == tracks.track[:-1]
    dx, dy, dt = (np.diff(column)[same] for column in (tracks.x, tracks.y, tracks.t))
    step = wrap_angle(np.diff(tracks.heading)[same])
    angle = wrap_angle(tracks.heading[:-1][same] + step / 2 - np.arctan2(dy, dx))[
        np.hypot(dx, dy) > MOVING * dt
    ]
    if not len(angle):
        return 0.0
    low, middle, high = np.percentile(angle, (5, 50, 95))
    return float(middle) if abs(middle) > LEAST_TURN and high - low < WIDEST_BAND else 0.0


def _true_first_time(samples: Floats) -> float:
    """Return the time of a track's first sample by the speeds [s]; columns as in `SAMPLE`."""
    t, x, y, _, speed = samples[:3].T
    if len(t) < 3 or speed[0] < MOVING:
        return t[0]
    way, mean, dt = np.hypot(np.diff(x), np.diff(y)), (speed[1:] + speed[:-1]) / 2, np.diff(t)
    # Equal positions tell no time.
    is_short = 1e-6 < way[0] < SHORT * mean[0] * dt[0]
    return t[1] - way[0] / mean[0] if is_short and abs(way[1] / (mean[1] * dt[1]) - 1) < AGREES else t[0]
