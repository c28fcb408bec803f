"""Names of a run, and columns of the table of its test."""

from __future__ import annotations

from pathlib import Path

from benchmark.experiment.runs import SCRIPTED, SCRIPTED_SEED
from benchmark.metrics.table import EPISODE_KEYS, START

LABELS = {
    *("algorithm", "training_seed", "task", "task_traffic", "mode", "split", "agent", "is_invalid", "agents"),
    *EPISODE_KEYS,
    *START,
}
"""Columns that every table of a run has."""
RATES = ("completion_rate", "collision_rate")
"""Metrics that every table has, with a number for each agent that took part. Columns of other metrics may be
absent or lack numbers: the metric is n/a then."""

Names = tuple[str, str, str, int]
"""Of a run: algorithm or policy, task, traffic, training seed."""


def names_of(folder: Path) -> Names | None:
    """Return the names of the run in a folder, by the end of its path; None if it is not a run's."""
    kind, second, third, last = folder.parts[-4:] if len(folder.parts) >= 4 else [""] * 4
    if kind == SCRIPTED:
        return second, third, last, SCRIPTED_SEED
    if last.startswith("seed_") and last[5:].isdecimal():
        return kind, second, third, int(last[5:])
    return None
