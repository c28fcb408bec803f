"""Whether one algorithm is better than another, and how many of them are over a table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtr

from benchmark.statistics.intervals import seed_interval

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Difference:
    """The first minus the second, over what both have played."""

    value: float
    low: float
    high: float
    p_value: float
    """Two-sided, that there is no difference."""
    pairs: int
    """Training seeds or, with fewer than three, starts that were compared."""

    @property
    def is_tie(self) -> bool:
        """Whether the interval contains 0."""
        return not (self.low > 0.0 or self.high < 0.0)


def paired_difference(first: ArrayLike, second: ArrayLike) -> Difference:
    """Return the paired difference over common training seeds and starts.

    With three seeds or more that both have, by Student's interval on the seeds' differences of means over
    the starts. With fewer, by that on the starts' differences, which then tells of these checkpoints only.
    NaN where one has not played a start with a seed: the other is left out, too.

    Differences that are all alike tell of no spread, which would make two of them as good as two hundred: a
    further one of 0 is counted in for interval and p-value then.

    Args:
        first: Mean over the agents of an episode, shape (S, K): row = training seed, column = start.
        second: The same of the other algorithm, rows and columns alike.
    """
    gap = np.asarray(first, float) - np.asarray(second, float)
    gap = gap[np.isfinite(gap).any(axis=1)][:, np.isfinite(gap).any(axis=0)]
    units = np.nanmean(gap, axis=1) if len(gap) >= 3 else _mean_over_seeds(gap)
    if len(units) < 2:
        value = float(units[0]) if len(units) else float("nan")
        return Difference(value, float("nan"), float("nan"), float("nan"), len(units))
    value, counted = float(units.mean()), len(units)
    if value != 0.0 and np.ptp(units) == 0.0:
        units = np.append(units, 0.0)
    low, high = seed_interval(units)
    error = units.std(ddof=1) / np.sqrt(len(units))
    p_value = 2.0 * float(stdtr(len(units) - 1, -abs(float(units.mean())) / error)) if error > 0.0 else 1.0
    return Difference(value, float(low), float(high), p_value, counted)


def _mean_over_seeds(gap: Floats) -> Floats:
    return np.nanmean(gap, axis=0) if gap.size else np.zeros(0)


def holm(p_values: ArrayLike) -> Floats:
    """Return Holm's corrected p-values, NaN where they are NaN: below 0.05 is a difference within the table.

    Source: Holm, Scandinavian Journal of Statistics 6 (1979).
    """
    values = np.asarray(p_values, float)
    corrected = np.full(values.shape, np.nan)
    known = np.flatnonzero(np.isfinite(values))
    order = known[np.argsort(values[known], kind="stable")]
    factors = np.arange(len(order), 0, -1)
    corrected[order] = np.minimum(np.maximum.accumulate(values[order] * factors), 1.0)
    return corrected


def interquartile_mean(values: ArrayLike) -> float:
    """Return the mean of the middle half of the values, NaN left out; values at its edges count in part.

    Source: Agarwal et al., Deep Reinforcement Learning at the Edge of the Statistical Precipice (2021).
    """
    known = np.sort(np.asarray(values, float).ravel())
    known = known[np.isfinite(known)]
    if not len(known):
        return float("nan")
    edges = np.arange(len(known) + 1) / len(known)
    weights = np.clip(np.minimum(edges[1:], 0.75) - np.maximum(edges[:-1], 0.25), 0.0, None)
    return float(weights @ known / weights.sum())
