"""Metrics of recorded episodes: `measure_episodes` reads them into a table, `compute` aggregates it.

    table = measure_episodes(Path("results/run/episodes"), labels={"algorithm": "ppo", "training_seed": 0})
    print(compute(table, ["algorithm", "scenario", "traffic"]))

A further metric is a `Measure` of what an `EpisodeData` holds: in this package one file and a line in
`METRICS`; in a user's code "module:NAME", which may stand wherever a metric is named.
"""

from benchmark.metrics.differences import compare
from benchmark.metrics.episode_data import EpisodeData
from benchmark.metrics.live import Episode, EpisodeLog, Metric
from benchmark.metrics.measure import Columns, Measure, Totals, share
from benchmark.metrics.registry import METRICS
from benchmark.metrics.results import compute
from benchmark.metrics.table import join_tables, measure_episodes, read_table, write_table

__all__ = [
    "METRICS",
    "Columns",
    "Episode",
    "EpisodeData",
    "EpisodeLog",
    "Measure",
    "Metric",
    "Totals",
    "compare",
    "compute",
    "join_tables",
    "measure_episodes",
    "read_table",
    "share",
    "write_table",
]
