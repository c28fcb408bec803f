"""Resampling by episode: agents of one episode stay together."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmark.statistics.intervals import LEVEL, Bounds

Floats = NDArray[np.float64]

REPEATS = 2000
"""Bootstrap samples."""


def bootstrap_totals(
    totals: Floats, draws: np.random.Generator, strata: ArrayLike | None = None, repeats: int = REPEATS
) -> Floats:
    """Return bootstrap sums: episodes resampled with replacement within each stratum.

    Args:
        totals: Sums of C columns in each of K episodes, shape (K, C).
        draws: Source of randomness.
        strata: Number of each episode's stratum (training seed, split), shape (K,); by default there is one.
        repeats: R, how often to draw K episodes.

    Returns:
        Shape (R, C).
    """
    of = np.zeros(len(totals), int) if strata is None else np.asarray(strata)
    drawn = np.zeros((repeats, totals.shape[1]))
    for stratum in np.unique(of).tolist():
        own = totals[of == stratum]
        drawn += draws.multinomial(len(own), np.full(len(own), 1.0 / len(own)), size=repeats) @ own
    return drawn


def bootstrap_interval(values: Floats) -> Bounds:
    """Return the percentile interval of resampled values, shape (R,); NaN is ignored."""
    known = values[np.isfinite(values)]
    if not len(known):
        return np.array(np.nan), np.array(np.nan)
    low, high = np.quantile(known, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return low, high
