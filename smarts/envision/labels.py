"""Where labels go in a picture so that they do not overlap."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties

from smarts.arrays import Floats

NEAR = 8.0
"""Distance between an anchor and its label, and between candidate rings [pixels]."""
RINGS = 6
"""Number of candidate rings around an anchor."""
OBSTACLE_COST = 0.1
"""Cost per covered obstacle pixel; a covered label pixel costs 1."""


class TextMeasure:
    """Measures texts of one size and weight as they are drawn [pixels]."""

    def __init__(self, size: float, weight: str, dpi: float) -> None:
        self._renderer = FigureCanvasAgg(Figure(dpi=dpi)).get_renderer()
        self._font = FontProperties(size=size, weight=weight)

    def __call__(self, text: str) -> tuple[float, float]:
        """Return width and height."""
        width, height, _ = self._renderer.get_text_width_height_descent(text, self._font, ismath=False)
        return width, height


def place_labels(
    anchors: Sequence[tuple[float, float]],
    sizes: Sequence[tuple[float, float]],
    obstacles: Floats,
    bounds: tuple[float, float, float, float],
) -> list[tuple[float, float]]:
    """Return the middles of labels [pixels], each near its anchor, one after the other.

    A label takes the nearest place that covers no label before it and lies within the bounds; among those,
    one that covers few of the obstacles.

    Args:
        anchors: What the labels belong to.
        sizes: Width and height of each.
        obstacles: Left, bottom, right and top of what should stay visible, shape (N, 4).
        bounds: Left, bottom, right and top of the room for labels.
    """
    placed = np.empty((0, 4))
    middles = []
    for anchor, size in zip(anchors, sizes, strict=True):
        half = np.array(size) / 2
        tried = [(*middle, ring) for middle, ring in _candidates(anchor, size)]
        costs = [_cost(np.array([x, y]), half, placed, obstacles, bounds) + ring for x, y, ring in tried]
        x, y, _ = tried[int(np.argmin(costs))]
        middles.append((x, y))
        placed = np.vstack([placed, [x - half[0], y - half[1], x + half[0], y + half[1]]])
    return middles


def _candidates(
    anchor: tuple[float, float], size: tuple[float, float]
) -> Iterator[tuple[tuple[float, float], int]]:
    """Yield middles of a label round its anchor, and how many steps they are away."""
    for ring in range(RINGS):
        away = NEAR * (1 + 2 * ring)
        for right, up in product((1, -1, 0), (1, -1, 0)):
            if right or up:
                x = anchor[0] + right * (away + size[0] / 2)
                yield (x, anchor[1] + up * (away + size[1] / 2)), ring


def _cost(
    middle: Floats, half: Floats, placed: Floats, obstacles: Floats, bounds: tuple[float, float, float, float]
) -> float:
    box = np.concatenate([middle - half, middle + half])
    outside = np.maximum(0, np.array(bounds[:2]) - box[:2]) + np.maximum(0, box[2:] - np.array(bounds[2:]))
    beyond = float(outside.sum()) * float(half.sum())
    return beyond + _covered(box, placed) + OBSTACLE_COST * _covered(box, obstacles)


def _covered(box: Floats, others: Floats) -> float:
    """Return the area that a box shares with others [pixels^2]."""
    shared = np.minimum(box[2:], others[:, 2:]) - np.maximum(box[:2], others[:, :2])
    return float(np.maximum(shared, 0).prod(-1).sum())
