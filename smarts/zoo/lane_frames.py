"""Poses in the frame of a lane, in which a curved road is straight; arrays of N lanes and K poses of each.

The frame of Werling, Ziegler, Kammel and Thrun, "Optimal trajectory generation for dynamic street scenarios
in a Frenet frame", ICRA 2010: station along the lane from beside the vehicle on [m], offset to its left [m],
heading relative to it [rad].
"""

from __future__ import annotations

import numpy as np

from smarts.arrays import Floats
from smarts.geometry.frames import wrap_angle
from smarts.observations.lane_ways import BEHIND
from smarts.observations.way_ahead import SPACING

LEAST_RADIUS = 0.3
"""A vehicle's radius in a bend is at least this part of its lane's: nearer to the centre stations blur."""


def to_lane(ways: Floats, poses: Floats) -> Floats:
    """Return stations, offsets and relative headings of poses on the map, shape (N, K, 3).

    Beyond the ends of a way its first and last segment are extended straight.

    Args:
        ways: Points x, y, heading of each lane, as `lane_ways` has them, shape (N, P, 3).
        poses: x, y, heading, shape (N, K, 3).
    """
    dx = poses[:, :, None, 0] - ways[:, None, :, 0]
    dy = poses[:, :, None, 1] - ways[:, None, :, 1]
    nearest = np.argmin(dx * dx + dy * dy, axis=2)
    lane = np.arange(len(ways))[:, None]
    at = ways[lane, nearest]
    cosine, sine = np.cos(at[..., 2]), np.sin(at[..., 2])
    dx, dy = poses[..., 0] - at[..., 0], poses[..., 1] - at[..., 1]
    along, aside = dx * cosine + dy * sine, dy * cosine - dx * sine
    after = ways[lane, np.clip(nearest + np.where(along < 0.0, -1, 1), 0, ways.shape[1] - 1)]
    turned = wrap_angle(after[..., 2] - at[..., 2]) * np.minimum(np.abs(along) / SPACING, 1.0)
    station = (nearest - BEHIND) * SPACING + along
    return np.stack([station, aside, wrap_angle(poses[..., 2] - at[..., 2] - turned)], axis=2)


def to_map(ways: Floats, poses: Floats) -> Floats:
    """Return x, y, heading of poses in frames of lanes, shape (N, K, 3); the inverse of `to_lane`."""
    place = poses[..., 0] / SPACING + BEHIND
    # NaN has no place; its pose is NaN whatever the point.
    point = np.clip(np.nan_to_num(np.floor(place)), 0, ways.shape[1] - 2).astype(np.int64)
    lane, share = np.arange(len(ways))[:, None], place - point
    a, b = ways[lane, point], ways[lane, point + 1]
    heading = a[..., 2] + np.clip(share, 0.0, 1.0) * wrap_angle(b[..., 2] - a[..., 2])
    x = a[..., 0] + share * (b[..., 0] - a[..., 0]) - poses[..., 1] * np.sin(heading)
    y = a[..., 1] + share * (b[..., 1] - a[..., 1]) + poses[..., 1] * np.cos(heading)
    return np.stack([x, y, wrap_angle(heading + poses[..., 2])], axis=2)


def stretches(ways: Floats, stations: Floats, offsets: Floats) -> Floats:
    """Return the ratio of speed along lanes to the speed driven, 1 / (1 - curvature * offset), shape (N, K).

    Args:
        ways: As `to_lane` takes them, shape (N, P, 3).
        stations: Stations of vehicles that drive along the lanes [m], shape (N, K).
        offsets: Theirs to the left [m], shape (N, K).
    """
    point = np.clip(np.nan_to_num(np.rint(stations / SPACING)) + BEHIND, 1, ways.shape[1] - 2).astype(
        np.int64
    )
    lane = np.arange(len(ways))[:, None]
    curvature = wrap_angle(ways[lane, point + 1, 2] - ways[lane, point - 1, 2]) / (2.0 * SPACING)
    return 1.0 / np.maximum(1.0 - curvature * offsets, LEAST_RADIUS)
