"""Intervals for means and rates; functions take any leading axes and work along the last one."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri, stdtrit

Floats = NDArray[np.float64]
Bounds = tuple[Floats, Floats]
"""Lower and upper bound."""

LEVEL = 0.95
"""Confidence level by default."""


def seed_interval(means: ArrayLike, level: float = LEVEL) -> Bounds:
    """Return Student's interval for the mean over training seeds.

    Args:
        means: Of each seed, shape (..., S); S at least 2.
        level: Confidence level.
    """
    values = np.asarray(means, float)
    seeds = values.shape[-1]
    error = values.std(axis=-1, ddof=1) / np.sqrt(seeds)
    reach = stdtrit(seeds - 1, (1 + level) / 2) * error
    centre = values.mean(axis=-1)
    return centre - reach, centre + reach


def arcsine_interval(rates: ArrayLike, counts: ArrayLike, level: float = LEVEL) -> Bounds:
    """Return the interval for a rate over three training seeds or more.

    Student's interval on arcsine-root-transformed seed rates, transformed back: on that scale the spread of
    a rate does not depend on the rate. Seeds that agree by chance give too narrow an interval; the result
    always contains the Wilson interval of the pooled trials.

    Args:
        rates: Of each seed, shape (..., S).
        counts: Independent trials behind each rate, shape (..., S).
        level: Confidence level.
    """
    rates = np.asarray(rates, float)
    low, high = seed_interval(np.arcsin(np.sqrt(np.clip(rates, 0.0, 1.0))), level)
    low = np.sin(np.clip(low, 0.0, np.pi / 2)) ** 2
    high = np.sin(np.clip(high, 0.0, np.pi / 2)) ** 2
    counts = np.asarray(counts, float)
    total = counts.sum(axis=-1)
    least = wilson_interval((rates * counts).sum(axis=-1) / total, total, level)
    return np.minimum(low, least[0]), np.maximum(high, least[1])


def wilson_interval(rate: ArrayLike, count: ArrayLike, level: float = LEVEL) -> Bounds:
    """Return Wilson's score interval for a rate of `count` independent trials, whole number or not."""
    rate, count = np.asarray(rate, float), np.asarray(count, float)
    quantile = ndtri((1 + level) / 2)
    square = quantile**2
    centre = (rate + square / (2 * count)) / (1 + square / count)
    reach = quantile / (1 + square / count)
    reach = reach * np.sqrt(rate * (1 - rate) / count + square / (4 * count**2))
    # Exactly 0 and 1 at the edges, whatever is rounded.
    low = np.where(rate <= 0.0, 0.0, np.maximum(centre - reach, 0.0))
    return low, np.where(rate >= 1.0, 1.0, np.minimum(centre + reach, 1.0))


def design_effect(successes: ArrayLike, trials: ArrayLike) -> Floats:
    """Return the design effect of agents in episodes.

    That is the variance of the rate between episodes over that of independent trials, clipped to
    [1, agents per episode]. Equal episodes give the upper bound.

    Args:
        successes: Successes of each episode, shape (..., K).
        trials: Agents of each episode, same shape.

    Source: Kish, Survey Sampling (1965), section 8.2; ratio estimator for unequal episodes.
    """
    hits, agents = np.asarray(successes, float), np.asarray(trials, float)
    episodes = hits.shape[-1]
    total = agents.sum(axis=-1)
    rate = hits.sum(axis=-1) / total
    most = (agents**2).sum(axis=-1) / total
    residual = hits - rate[..., None] * agents
    between = (residual**2).sum(axis=-1) / max(episodes - 1, 1) * episodes / total**2
    alone = rate * (1 - rate) / total
    with np.errstate(divide="ignore", invalid="ignore"):
        effect = between / alone
    return np.where((alone > 0) & (episodes > 1), np.clip(effect, 1.0, most), most)


def checkpoint_interval(successes: ArrayLike, trials: ArrayLike, level: float = LEVEL) -> Bounds:
    """Return the interval for the rate of one or two checkpoints, whatever other training seeds may give.

    Wilson's at agent-episodes / `design_effect`.

    Args:
        successes: Successes of each episode, shape (..., K).
        trials: Agents of each episode, same shape.
        level: Confidence level.
    """
    agents = np.asarray(trials, float).sum(axis=-1)
    rate = np.asarray(successes, float).sum(axis=-1) / agents
    return wilson_interval(rate, agents / design_effect(successes, trials), level)


def mover_interval(
    value: float, bounds: tuple[float, float], other: float, others: tuple[float, float]
) -> Bounds:
    """Return the interval for the difference of two independent estimates from their own intervals.

    Args:
        value: The minuend.
        bounds: Its interval.
        other: The subtrahend.
        others: Its interval, of the same level.

    Source: Zou and Donner, Construction of confidence limits about effect measures: a general approach,
    Statistics in Medicine 27 (2008): method of variance estimates recovery (MOVER).
    """
    difference = value - other
    low = difference - np.hypot(value - bounds[0], others[1] - other)
    high = difference + np.hypot(bounds[1] - value, other - others[0])
    return low, high
