"""Shapes of bubbles in pictures."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
import shapely
from matplotlib.artist import Artist
from matplotlib.patches import FancyArrowPatch, PathPatch
from matplotlib.path import Path
from matplotlib.text import Text
from shapely.geometry.polygon import orient

from smarts.arrays import Floats

BUBBLE = "#9467bd"
ARROW = 8.0
"""Length of the arrow at a bubble that travels [m]."""


def bubble_shapes(
    zone: Sequence[Floats],
    margin: Sequence[Floats],
    *,
    name: str,
    heading: float | None = None,
    is_active: bool = True,
) -> Iterator[Artist]:
    """Yield the shapes of a bubble: its zone, its margin as a dashed line, its name above.

    Args:
        zone: Rings of the zone, each of shape (., 2) [m].
        margin: Rings of the zone with its margin.
        name: Written above the left end of the margin, where roads and the arrow rarely are.
        heading: Heading of the vehicle with which it travels, shown by an arrow [rad]; None if it stays.
        is_active: Whether it takes vehicles; if not, the zone is not filled.
    """
    colour = {"facecolor": BUBBLE if is_active else "none", "edgecolor": BUBBLE}
    yield PathPatch(_path(zone), alpha=0.25, lw=1.0, zorder=4, **colour)
    yield PathPatch(_path(margin), fill=False, edgecolor=BUBBLE, linestyle="--", lw=1.0, zorder=5)
    corners = np.concatenate([*margin])
    low, high = corners.min(0), corners.max(0)
    text = name if is_active else f"{name} (not active)"
    style = {"ha": "left", "va": "bottom", "fontsize": 8, "color": BUBBLE, "weight": "bold"}
    frame = {"boxstyle": "round,pad=0.2", "fc": "white", "ec": "none", "alpha": 0.75}
    yield Text(low[0], high[1], text, zorder=9, clip_on=True, bbox=frame, parse_math=False, **style)
    if heading is not None:
        centre, ahead = (low + high) / 2, np.array([np.cos(heading), np.sin(heading)])
        begin = centre + ahead * ((corners - centre) @ ahead).max()
        ends = tuple(begin), tuple(begin + ARROW * ahead)
        yield FancyArrowPatch(*ends, arrowstyle="-|>", mutation_scale=12, color=BUBBLE, zorder=8)


def placed_shapes(
    zone: Sequence[Floats],
    margin: Sequence[Floats],
    pose: Sequence[float],
    *,
    name: str,
    travels: bool,
    is_active: bool,
) -> Iterator[Artist]:
    """Yield the shapes of a bubble at a pose; the rings of one that travels are as before it follows."""
    moved_zone, moved_margin = ([moved(ring, pose) for ring in rings] for rings in (zone, margin))
    # Outlines are given for a vehicle that faces north.
    heading = pose[2] + math.pi / 2 if travels else None
    yield from bubble_shapes(moved_zone, moved_margin, name=name, heading=heading, is_active=is_active)


def moved(ring: Floats, pose: Sequence[float]) -> Floats:
    """Return a ring at a pose x, y, angle: turned about (0, 0), then shifted."""
    x, y, angle = pose
    if not any(pose):
        return ring
    cos, sin = np.cos(angle), np.sin(angle)
    return ring @ np.array([[cos, sin], [-sin, cos]]) + (x, y)


def rings_of(area: shapely.Geometry) -> list[Floats]:
    """Return the outline of polygons as closed rings, each of shape (., 2) [m]."""
    polygons = [orient(each) for each in shapely.get_parts(area) if isinstance(each, shapely.Polygon)]
    return [np.asarray(ring.coords)[:, :2] for each in polygons for ring in (each.exterior, *each.interiors)]


def _path(rings: Sequence[Floats]) -> Path:
    return Path.make_compound_path(*(Path(ring, closed=True) for ring in rings))
