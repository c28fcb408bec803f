"""Whether one algorithm is better than another at equal starts, and Holm's correction over a table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtr, stdtrit

from benchmark.statistics.intervals import LEVEL

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Difference:
    """The first minus the second, over what both have played."""

    value: float
    low: float
    high: float
    p_value: float
    """Two-sided, that there is no difference; NaN with fewer than two starts."""
    pairs: int
    """Starts that were compared."""


def paired_difference(gaps: ArrayLike, is_share_of_counts: bool = False) -> Difference:
    """Return the mean difference over distinct starts with Student's interval.

    If all differences of rates are equal or nearly so, the sample variance is too small. Their standard error
    is therefore at least that of matched pairs with two pseudo-observations (Agresti and Min 2005).
    Other differences that are all alike, but not 0, have no interval.

    Args:
        gaps: First minus second at each start, shape (K,); starts are the unit, so each stands here once.
        is_share_of_counts: Whether they are differences of such shares, in [-1, 1].

    Source: Agresti and Min, Simple improved confidence intervals for comparing matched proportions,
    Statistics in Medicine 24 (2005); here of starts, whatever the agents in one of them share.
    """
    units = np.asarray(gaps, float)
    count = len(units)
    value = float(units.mean()) if count else float("nan")
    if count < 2:
        return Difference(value, float("nan"), float("nan"), float("nan"), count)
    error = units.std(ddof=1) / np.sqrt(count)
    if is_share_of_counts:
        square = (units**2).sum() + 1.0 - units.sum() ** 2 / (count + 2)
        error = max(error, np.sqrt(square) / (count + 2))
    if error == 0.0:
        end, p_value = (0.0, 1.0) if value == 0.0 else (float("nan"), float("nan"))
        return Difference(value, end, end, p_value, count)
    reach = float(stdtrit(count - 1, (1 + LEVEL) / 2) * error)
    low, high = value - reach, value + reach
    if is_share_of_counts:
        low, high = max(low, -1.0), min(high, 1.0)
    return Difference(value, low, high, 2.0 * float(stdtr(count - 1, -abs(value) / error)), count)


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
