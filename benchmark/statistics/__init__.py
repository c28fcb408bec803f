"""Confidence intervals and tests for clustered data: agents in episodes, episodes in training seeds."""

from benchmark.statistics.comparison import (
    Difference,
    holm,
    paired_difference,
)
from benchmark.statistics.intervals import (
    LEVEL,
    arcsine_interval,
    checkpoint_interval,
    design_effect,
    mover_interval,
    seed_interval,
    wilson_interval,
)
from benchmark.statistics.resampling import bootstrap_counts, bootstrap_interval
from benchmark.statistics.summaries import (
    interquartile_mean,
    performance_profile,
    probability_of_improvement,
    stratified_interval,
)

__all__ = [
    "LEVEL",
    "Difference",
    "arcsine_interval",
    "bootstrap_counts",
    "bootstrap_interval",
    "checkpoint_interval",
    "design_effect",
    "holm",
    "interquartile_mean",
    "mover_interval",
    "paired_difference",
    "performance_profile",
    "probability_of_improvement",
    "seed_interval",
    "stratified_interval",
    "wilson_interval",
]
