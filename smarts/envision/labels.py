"""Places labels in a picture so that they do not overlap."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties

from smarts.arrays import Floats

NEAR = 8.0
"""Distance between an anchor and its label; candidate rings are twice as far apart [pixels]."""
RINGS = 6
"""Number of candidate rings around an anchor."""
OBSTACLE_COST = 0.1
"""Cost per covered obstacle pixel; a covered pixel of another label costs 1."""


class TextMeasure:
    """Measures drawn texts of one font size and weight."""

    def __init__(self, size: float, weight: str, dpi: float) -> None:
        self._renderer = FigureCanvasAgg(Figure(dpi=dpi)).get_renderer()
        self._font = FontProperties(size=size, weight=weight)

    def __call__(self, text: str) -> tuple[float, float]:
        """Return width and height [pixels]."""
        width, height, _ = self._renderer.get_text_width_height_descent(text, self._font, ismath=False)
        return width, height


def place_labels(
    anchors: Sequence[tuple[float, float]],
    sizes: Sequence[tuple[float, float]],
    obstacles: Floats,
    bounds: tuple[float, float, float, float],
) -> list[tuple[float, float]]:
    """Return the centres of labels [pixels], placed one after the other.

    Each label takes the candidate with the lowest cost: distance from its anchor, overlap with labels placed
    before, area outside the bounds and, with a lower weight, overlap with obstacles.

    Args:
        anchors: Points that the labels belong to [pixels].
        sizes: Width and height of each label [pixels].
        obstacles: Left, bottom, right and top of boxes to keep visible [pixels], shape (N, 4).
        bounds: Left, bottom, right and top of the area for labels [pixels].
    """
    placed = np.empty((0, 4))
    centres = []
    for anchor, size in zip(anchors, sizes, strict=True):
        half = np.array(size) / 2
        candidates = [(*centre, ring) for centre, ring in _candidates(anchor, size)]
        costs = [_cost(np.array([x, y]), half, placed, obstacles, bounds) + ring for x, y, ring in candidates]
        x, y, _ = candidates[int(np.argmin(costs))]
        centres.append((x, y))
        placed = np.vstack([placed, [x - half[0], y - half[1], x + half[0], y + half[1]]])
    return centres


def _candidates(
    anchor: tuple[float, float], size: tuple[float, float]
) -> Iterator[tuple[tuple[float, float], int]]:
    """Yield candidate centres of a label around its anchor, and the ring of each, from 0."""
    for ring in range(RINGS):
        away = NEAR * (1 + 2 * ring)
        for right, up in product((1, -1, 0), (1, -1, 0)):
            if right or up:
                x = anchor[0] + right * (away + size[0] / 2)
                yield (x, anchor[1] + up * (away + size[1] / 2)), ring


def _cost(
    centre: Floats, half: Floats, placed: Floats, obstacles: Floats, bounds: tuple[float, float, float, float]
) -> float:
    box = np.concatenate([centre - half, centre + half])
    outside = np.maximum(0, np.array(bounds[:2]) - box[:2]) + np.maximum(0, box[2:] - np.array(bounds[2:]))
    beyond = float(outside.sum()) * float(half.sum())
    return beyond + _covered(box, placed) + OBSTACLE_COST * _covered(box, obstacles)


def _covered(box: Floats, others: Floats) -> float:
    """Return the total area that a box shares with others [pixels^2]."""
    shared = np.minimum(box[2:], others[:, 2:]) - np.maximum(box[:2], others[:, :2])
    return float(np.maximum(shared, 0).prod(-1).sum())
