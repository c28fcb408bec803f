"""Intervals and comparisons for agents that come in episodes, and episodes that come in training seeds.

Nothing here knows what is measured; `benchmark.metrics` says it.
"""

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
from benchmark.statistics.resampling import resampled_totals, sampled_interval

__all__ = [
    "LEVEL",
    "Difference",
    "arcsine_interval",
    "checkpoint_interval",
    "design_effect",
    "holm",
    "interquartile_mean",
    "paired_difference",
    "resampled_totals",
    "sampled_interval",
    "seed_interval",
    "wilson_interval",
]
