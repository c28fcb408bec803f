"""Bringing a recording into the coordinates of its map, as `TrafficHistoryDataset` says."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from smarts.geometry.frames import wrap_angle
from smarts.recordings.tracks import Tracks


@dataclass(frozen=True)
class Transform:
    """What is done to positions, in this order."""

    swap_xy: bool = False
    """Whether x and y are exchanged."""
    scale: float = 1.0
    """Size on the map over size in the world."""
    x_margin: float = 0.0
    """Subtracted from x [m on the map]."""
    y_margin: float = 0.0
    """Subtracted from y [m on the map]."""
    flip_y: float | None = None
    """The map's largest y [m], from which y is subtracted; None: y stays."""


def transformed(tracks: Tracks, transform: Transform) -> Tracks:
    """Return a recording in the coordinates of its map; headings, speeds and sizes follow."""
    signals, along, across = tracks.signals.copy(), np.cos(tracks.heading), np.sin(tracks.heading)
    x, y = np.vstack([np.column_stack([tracks.x, tracks.y]), signals[:, 1:5].reshape(-1, 2)]).T
    if transform.swap_xy:
        x, y, along, across = y, x, across, along
    x = x * transform.scale - transform.x_margin
    y = y * transform.scale - transform.y_margin
    if transform.flip_y is not None:
        y, across = transform.flip_y - y, -across
    sizes = {name: getattr(tracks, name) * transform.scale for name in ("length", "width", "speed")}
    heading, count = wrap_angle(np.arctan2(across, along)), len(tracks.x)
    signals[:, 1:5] = np.column_stack([x, y])[count:].reshape(-1, 4)
    return replace(tracks, x=x[:count], y=y[:count], heading=heading, signals=signals, **sizes)
