"""Shapes of vehicles in pictures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.collections import LineCollection, PolyCollection

from smarts.arrays import Floats

EGOS = ("#d62728", "#e0627d", "#9e2a6b", "#8c564b")
CAR = "#2c5f8a"
SOCIAL = "#ff7f0e"
"""Colours of the vehicles of egos, of traffic and of social agents."""
STRIPES = (-0.38, -0.2, -0.02)
"""Places of the stripes across a vehicle in an air-lock, in lengths from its centre."""
STRIPE = 0.09
"""Width of a stripe, in lengths of the vehicle."""
HATCH = "#1a1a1a"


def vehicle_shapes(
    x: Floats,
    y: Floats,
    heading: Floats,
    length: Floats,
    width: Floats,
    *,
    colours: Sequence[str],
    edge_width: float,
) -> tuple[PolyCollection, PolyCollection]:
    """Return the footprints of V vehicles, and light bars across their fronts."""
    nose = 0.3 * length
    front = x + nose * np.cos(heading), y + nose * np.sin(heading)
    boxes = list(footprints(x, y, heading, length, width))
    noses = list(footprints(*front, heading, 0.16 * length, 0.8 * width))
    return (
        PolyCollection(boxes, facecolors=colours, edgecolors="k", linewidths=edge_width, zorder=6),
        PolyCollection(noses, facecolors="#e8eef5", edgecolors="none", zorder=7),
    )


def footprints(x: Floats, y: Floats, heading: Floats, length: Floats, width: Floats) -> Floats:
    """Return the corners of V footprints, shape (V, 4, 2)."""
    ahead = np.stack([np.cos(heading), np.sin(heading)], -1) * (length / 2)[:, None]
    aside = np.stack([-np.sin(heading), np.cos(heading)], -1) * (width / 2)[:, None]
    centre = np.stack([x, y], -1)
    return centre[:, None] + np.stack([ahead + aside, aside - ahead, -ahead - aside, ahead - aside], 1)


def air_lock_stripes(
    x: Floats, y: Floats, heading: Floats, length: Floats, width: Floats, *, colours: Sequence[str]
) -> PolyCollection:
    """Return stripes across V vehicles that agents observe before they drive."""
    stripes: list[Floats] = []
    for place in STRIPES:
        along = place * length
        centre = x + along * np.cos(heading), y + along * np.sin(heading)
        stripes += [*footprints(*centre, heading, STRIPE * length, width)]
    return PolyCollection(stripes, facecolors=[*colours] * len(STRIPES), edgecolors="none", zorder=7)


def leaving_hatch(x: Floats, y: Floats, heading: Floats, length: Floats, width: Floats) -> LineCollection:
    """Return slanted lines across V vehicles that are to go back to traffic."""
    lines: list[Floats] = []
    for place in STRIPES:
        # From corner to corner of a rectangle that is as long as the vehicle is wide.
        middle = place * length
        centre = x + middle * np.cos(heading), y + middle * np.sin(heading)
        lines += [*footprints(*centre, heading, np.minimum(width, 0.2 * length), width)[:, ::2]]
    return LineCollection(lines, colors=HATCH, linewidths=1.4, zorder=7)
