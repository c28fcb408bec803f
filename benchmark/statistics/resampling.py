"""Resampling by episode: agents of one episode stay together."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmark.statistics.intervals import LEVEL, Bounds

Floats = NDArray[np.float64]

REPEATS = 2000


def resampled_totals(
    totals: Floats, draws: np.random.Generator, repeats: int = REPEATS, episodes: int | None = None
) -> Floats:
    """Return sums over episodes that are drawn with replacement.

    Args:
        totals: Sums of C columns in each of K episodes, shape (K, C).
        draws: Source of randomness.
        repeats: R, how often to draw K episodes.
        episodes: How many to draw, by default K.

    Returns:
        Shape (R, C).
    """
    count = len(totals)
    weights = draws.multinomial(episodes or count, np.full(count, 1.0 / count), size=repeats)
    return weights @ totals


def sampled_interval(values: Floats) -> Bounds:
    """Return the percentile interval of resampled values, shape (R,); those that are NaN do not count."""
    known = values[np.isfinite(values)]
    if not len(known):
        return np.array(np.nan), np.array(np.nan)
    low, high = np.quantile(known, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return low, high
