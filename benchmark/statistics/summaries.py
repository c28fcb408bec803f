"""Summaries of training runs over tasks, with stratified bootstrap intervals.

Definitions are those of the package rliable: Agarwal et al., Deep Reinforcement Learning at the Edge of the
Statistical Precipice (2021).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmark.statistics.resampling import REPEATS, bootstrap_interval

Floats = NDArray[np.float64]
Statistic = Callable[..., Floats]


def interquartile_mean(values: ArrayLike) -> float:
    """Return the mean of the middle half of the values: a quarter of them, rounded down, is cut at each end.

    NaN is left out; without values it is NaN.
    """
    known = np.sort(np.asarray(values, float).ravel())
    known = known[np.isfinite(known)]
    cut = len(known) // 4
    return float(known[cut : len(known) - cut].mean()) if len(known) else float("nan")


def performance_profile(scores: ArrayLike, thresholds: ArrayLike) -> Floats:
    """Return the share of runs with a score above each threshold.

    Args:
        scores: Of S runs in each of M tasks, shape (S, M).
        thresholds: Shape (T,).

    Returns:
        Shape (T,).
    """
    return (np.asarray(scores, float)[None] > np.asarray(thresholds, float)[:, None, None]).mean(axis=(1, 2))


def probability_of_improvement(first: ArrayLike, second: ArrayLike) -> float:
    """Return the probability that a run of the first is better than one of the second, mean over tasks.

    Equal scores count half, as in the Mann-Whitney U statistic.

    Args:
        first: Scores, shape (S, M).
        second: Scores in the same tasks, shape (S', M).
    """
    gaps = np.asarray(first, float)[:, None] - np.asarray(second, float)[None]
    return float(((gaps > 0) + 0.5 * (gaps == 0)).mean())


def stratified_interval(
    statistic: Statistic, draws: np.random.Generator, *scores: Floats, repeats: int = REPEATS
) -> tuple[Floats, Floats]:
    """Return the 95% percentile interval of a statistic; runs are drawn with replacement within each task.

    Args:
        statistic: Of the scores; a number or shape (T,).
        draws: Source of randomness.
        scores: Of each algorithm, shape (S, M).
        repeats: Number of resamples.

    Returns:
        Lower and upper ends, of the statistic's shape.
    """
    found = np.array([statistic(*(_resampled(each, draws) for each in scores)) for _ in range(repeats)])
    if found.ndim == 1:
        return bootstrap_interval(found)
    ends = [bootstrap_interval(column) for column in found.T]
    return np.array([low for low, _ in ends]), np.array([high for _, high in ends])


def _resampled(scores: Floats, draws: np.random.Generator) -> Floats:
    rows = draws.integers(len(scores), size=scores.shape)
    return np.take_along_axis(scores, rows, axis=0)
