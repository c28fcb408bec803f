"""95% intervals for means and rates; every function takes any leading axes and works along the last one."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

Floats = NDArray[np.float64]
Bounds = tuple[Floats, Floats]
"""Lower and upper bound."""

LEVEL = 0.95
"""Confidence level."""
NORMAL_QUANTILE = 1.959964
"""Of (1 + LEVEL) / 2."""


def seed_interval(means: ArrayLike) -> Bounds:
    """Return Student's interval for the mean over training seeds.

    Args:
        means: Of each seed, shape (..., S); S at least 2.
    """
    values = np.asarray(means, float)
    seeds = values.shape[-1]
    error = values.std(axis=-1, ddof=1) / np.sqrt(seeds)
    reach = stdtrit(seeds - 1, (1 + LEVEL) / 2) * error
    centre = values.mean(axis=-1)
    return centre - reach, centre + reach


def arcsine_interval(rates: ArrayLike, counts: ArrayLike) -> Bounds:
    """Return the interval for a rate over three training seeds or more.

    Student's interval on arcsine-root-transformed seed rates, transformed back: on that scale the spread of
    a rate does not depend on the rate. Seeds that agree by chance give too narrow an interval; the result
    always contains the Wilson interval of the pooled trials.

    Args:
        rates: Of each seed, shape (..., S).
        counts: Independent trials behind each rate, shape (..., S).
    """
    rates = np.asarray(rates, float)
    low, high = seed_interval(np.arcsin(np.sqrt(np.clip(rates, 0.0, 1.0))))
    low = np.sin(np.clip(low, 0.0, np.pi / 2)) ** 2
    high = np.sin(np.clip(high, 0.0, np.pi / 2)) ** 2
    counts = np.asarray(counts, float)
    total = counts.sum(axis=-1)
    least = wilson_interval((rates * counts).sum(axis=-1) / total, total)
    return np.minimum(low, least[0]), np.maximum(high, least[1])


def wilson_interval(rate: ArrayLike, count: ArrayLike) -> Bounds:
    """Return Wilson's score interval for a rate of `count` independent trials, whole number or not."""
    rate, count = np.asarray(rate, float), np.asarray(count, float)
    square = NORMAL_QUANTILE**2
    centre = (rate + square / (2 * count)) / (1 + square / count)
    reach = NORMAL_QUANTILE / (1 + square / count)
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


def checkpoint_interval(successes: ArrayLike, trials: ArrayLike) -> Bounds:
    """Return the interval for the rate of one or two checkpoints, whatever other training seeds may give.

    Wilson's at agent-episodes / `design_effect`.

    Args:
        successes: Successes of each episode, shape (..., K).
        trials: Agents of each episode, same shape.
    """
    agents = np.asarray(trials, float).sum(axis=-1)
    rate = np.asarray(successes, float).sum(axis=-1) / agents
    return wilson_interval(rate, agents / design_effect(successes, trials))
