"""Headings of vehicles whose positions only were recorded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from smarts.arrays import Floats
from smarts.geometry.frames import wrap_angle


@dataclass(frozen=True)
class HeadingRule:
    """How headings follow from positions; fields and defaults are those of `TrafficHistoryDataset`."""

    window: int = 2
    """Number of intervals between positions that a heading is averaged over."""
    min_speed: float = 2.2
    """Below this speed the heading is held [m/s]."""
    max_turn: float | None = None
    """The fastest turn that is believed [rad/s]."""
    default: float = 0.0
    """The heading of a vehicle that never moves [rad]."""


def infer_headings(t: Floats, x: Floats, y: Floats, rule: HeadingRule) -> Floats:
    """Return the headings of a vehicle [rad], shape (n,).

    Each is the direction from the position half a window before to that half a window after. Where the
    vehicle is slower than `min_speed` it keeps its last heading, before its first it has its first.
    """
    rows = np.arange(len(t))
    before = np.maximum(rows - rule.window // 2, 0)
    after = np.minimum(before + max(rule.window, 1), len(t) - 1)
    dx, dy, dt = x[after] - x[before], y[after] - y[before], t[after] - t[before]
    is_moving = np.hypot(dx, dy) >= rule.min_speed * np.maximum(dt, 1e-9)
    if not is_moving.any():
        return np.full(len(t), wrap_angle(rule.default))
    last = np.maximum.accumulate(np.where(is_moving, rows, -1))
    last[last < 0] = np.argmax(is_moving)
    heading = np.unwrap(np.arctan2(dy, dx)[last])
    if rule.max_turn is not None:
        for row in rows[1:]:
            most = rule.max_turn * (t[row] - t[row - 1])
            heading[row] = heading[row - 1] + np.clip(heading[row] - heading[row - 1], -most, most)
    return wrap_angle(heading)
