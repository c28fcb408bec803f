"""Areas as closed rings in one array: a point is inside if it is inside an odd number of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from smarts.arrays import Floats, Ints
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import inside_outline


def rings_of(area: Any) -> tuple[Floats, ...]:
    """Return outlines and holes of shapely's polygon, or of several, each closed, shape (., 2)."""
    parts = [part for part in getattr(area, "geoms", (area,)) if not part.is_empty]
    rings = [ring for part in parts for ring in (part.exterior, *part.interiors)]
    return tuple(np.array(ring.coords, np.float64)[:, :2] for ring in rings)


def starts_of(counts: Sequence[int]) -> Ints:
    """Return where each of N parts in a row begins, and where the last ends, shape (N + 1,)."""
    return np.cumsum([0, *counts]).astype(np.int32)


@kernel
def inside_rings(x: float, y: float, points: Floats, ring_start: Ints, first: int, last: int) -> bool:
    """Return whether a point is inside an odd number of the rings from `first` up to `last`."""
    inside = False
    for ring in range(first, last):
        if inside_outline(x, y, points, ring_start[ring], ring_start[ring + 1]):
            inside = not inside
    return inside
