"""Confidence intervals and tests for clustered data: agents in episodes, episodes in training seeds."""

from benchmark.statistics.comparison import (
    Difference,
    holm,
    interquartile_mean,
    paired_difference,
)
from benchmark.statistics.intervals import (
    LEVEL,
    arcsine_interval,
    checkpoint_interval,
    design_effect,
    seed_interval,
    wilson_interval,
)
from benchmark.statistics.resampling import bootstrap_interval, bootstrap_totals

__all__ = [
    "LEVEL",
    "Difference",
    "arcsine_interval",
    "bootstrap_interval",
    "bootstrap_totals",
    "checkpoint_interval",
    "design_effect",
    "holm",
    "interquartile_mean",
    "paired_difference",
    "seed_interval",
    "wilson_interval",
]
