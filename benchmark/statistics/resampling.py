"""Resampling by episode: agents of one episode stay together."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmark.statistics.intervals import LEVEL, Bounds

Floats = NDArray[np.float64]

REPEATS = 2000
"""Bootstrap samples."""


def bootstrap_counts(strata: ArrayLike, draws: np.random.Generator, repeats: int = REPEATS) -> Floats:
    """Return how often each episode is drawn: with replacement within each stratum.

    Args:
        strata: Number of each episode's stratum (such as its training seed and split), shape (K,).
        draws: Source of randomness.
        repeats: R, how often to draw K episodes.

    Returns:
        Shape (R, K); the product with a column's sums by episode, shape (K,), is those of the resamples.
    """
    of = np.asarray(strata)
    drawn = np.zeros((repeats, len(of)))
    for stratum in np.unique(of).tolist():
        rows = np.flatnonzero(of == stratum)
        drawn[:, rows] = draws.multinomial(len(rows), np.full(len(rows), 1.0 / len(rows)), size=repeats)
    return drawn


def bootstrap_interval(values: Floats, level: float = LEVEL) -> Bounds:
    """Return the percentile interval of resampled values, shape (R,); NaN is ignored."""
    known = values[np.isfinite(values)]
    if not len(known):
        return np.array(np.nan), np.array(np.nan)
    low, high = np.quantile(known, [(1 - level) / 2, (1 + level) / 2])
    return low, high
