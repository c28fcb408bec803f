"""Metrics of recorded episodes: `measure_episodes` reads them into a table, `compute` says what it tells.

    table = measure_episodes(Path("results/run/episodes"), labels={"algorithm": "ppo", "training_seed": 0})
    print(compute(table, ["algorithm", "scenario", "traffic"]))

A further metric is one file with a `Measure` and a line in `METRICS`.
"""

from benchmark.metrics.differences import compare
from benchmark.metrics.live import Episode, EpisodeLog, Metric
from benchmark.metrics.registry import METRICS
from benchmark.metrics.results import compute
from benchmark.metrics.table import join_tables, measure_episodes, read_table, write_table

__all__ = [
    "METRICS",
    "Episode",
    "EpisodeLog",
    "Metric",
    "compare",
    "compute",
    "join_tables",
    "measure_episodes",
    "read_table",
    "write_table",
]
