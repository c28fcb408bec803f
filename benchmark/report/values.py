"""The value of every metric in every condition: the one table from which all pages are made."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
import pandas as pd

from benchmark.experiment.runs import SCRIPTED_SEED
from benchmark.metrics import METRICS, compute
from benchmark.metrics.results import THIS_CHECKPOINT, Frame, measured_in
from benchmark.results.plurals import counted
from benchmark.statistics import LEVEL
from smarts.registry import is_own_name

MODES = ("greedy", "sampled")
"""Modes in the order in which they are shown."""
GENERALIZATION = "generalization"
"""The metric of both splits; all others are of the training's variations."""
OUTCOMES = ("completion_rate", "collision_rate", *(name for name in METRICS if name.startswith("ended_")))
"""Metrics that are shares of outcomes and add up to 1."""
LEAST_P = 0.001
"""Smallest p-value that is shown; smaller ones are shown as below it."""
TEST_EPISODES = "the test episodes"
"""What the interval of a scripted policy covers."""
NO_SHARE = "no interval: the value is no share; give its Measure is_share=False"
THESE_CHECKPOINTS = "these checkpoints"
"""What the interval of two training seeds covers."""
COLUMNS = (
    *("algorithm", "kind", "task", "traffic", "mode", "metric", "value", "low", "high"),
    *("n", "count", "counted", "episodes", "seeds", "label", "note", "terms", "worst"),
)


@dataclass(frozen=True)
class Value:
    """A metric in a condition."""

    metric: str
    value: float
    """NaN: n/a, and `note` says why."""
    low: float
    high: float
    n: int
    """Agent-episodes."""
    count: float
    """Denominator; NaN if a table lacks a column."""
    counted: str
    """Unit of the denominator."""
    episodes: int
    seeds: int
    """Training seeds; none of a scripted policy."""
    label: str
    """What the interval covers, such as "3 training seeds"."""
    note: str
    terms: Mapping[str, float] = field(default_factory=dict)
    worst: str = ""
    """The held-out variation of least value, of which the terms then are."""

    @property
    def is_known(self) -> bool:
        """Whether there was something to measure."""
        return math.isfinite(self.value)

    @property
    def has_interval(self) -> bool:
        """Whether there is an interval."""
        return math.isfinite(self.low) and math.isfinite(self.high)

    @property
    def count_text(self) -> str:
        """What it was measured on, empty if that is all agent-episodes."""
        known = self.counted != "agent-episodes" and math.isfinite(self.count)
        return f"{self.count:,.0f} {self.counted}" if known else ""

    @property
    def seeds_text(self) -> str:
        """How many training seeds, empty for a scripted policy."""
        return counted(self.seeds, "seed") if self.seeds else ""

    @property
    def is_of_checkpoints(self) -> bool:
        """Whether the interval covers the trained policies, and no further training seeds."""
        return self.label in (THIS_CHECKPOINT, THESE_CHECKPOINTS)

    @property
    def digits(self) -> int:
        """Decimals that are shown."""
        return 2 if METRICS[self.metric].is_share else 1

    @property
    def sort(self) -> str:
        """Key by which the value is sorted, empty for n/a."""
        return f"{self.value:z.6g}" if self.is_known else ""

    @property
    def text(self) -> str:
        """The value as it is shown everywhere."""
        return f"{self.value:z.{self.digits}f}" if self.is_known else "n/a"

    @property
    def interval(self) -> str:
        """The interval as it is shown everywhere, empty without one."""
        return f"[{self.low:z.{self.digits}f}, {self.high:z.{self.digits}f}]" if self.has_interval else ""


Key = tuple[str, str, str, str, str]
"""Algorithm, task, traffic, mode, metric."""


def measure_conditions(table: Frame, metrics: Sequence[str] = (), level: float = LEVEL) -> Frame:
    """Return a row for each algorithm, condition, mode and metric, with `COLUMNS`.

    Args:
        table: Agent-episodes of all runs.
        metrics: Names, by default all whose columns the table has.
        level: Confidence level of the intervals.
    """
    if not len(table):
        return pd.DataFrame(columns=[*COLUMNS])
    by = ["algorithm", "task", "task_traffic", "mode"]
    trained_on = table[table["split"] != "held_out"]
    wanted = metrics or [measure.name for measure in measured_in(table)]
    parts = [compute(trained_on, by, [name for name in wanted if name != GENERALIZATION], level)]
    if GENERALIZATION in wanted:
        parts.append(compute(table, by, [GENERALIZATION], level))
    answer = pd.concat(parts, ignore_index=True).rename(columns={"task_traffic": "traffic"})
    scripted = set(table.loc[table["training_seed"] == SCRIPTED_SEED, "algorithm"])
    answer["kind"] = ["scripted" if name in scripted else "learning" for name in answer["algorithm"]]
    answer.loc[(answer["label"] == THIS_CHECKPOINT) & (answer["seeds"] > 1), "label"] = THESE_CHECKPOINTS
    # Nothing was trained: no seeds, no checkpoint.
    answer.loc[answer["kind"] == "scripted", ["seeds", "label"]] = [0, TEST_EPISODES]
    answer = _without_wrong_intervals(answer, table)
    order = {name: number for number, name in enumerate(METRICS)}
    answer = answer.sort_values(
        ["algorithm", "task", "traffic", "mode", "metric"],
        key=lambda column: column.map(order) if column.name == "metric" else column,
        kind="stable",
    )
    return answer[[*COLUMNS]].reset_index(drop=True)


def _without_wrong_intervals(values: Frame, table: Frame) -> Frame:
    """Return values without the intervals of own metrics that are no shares, though they say so.

    A metric is none if the value of an agent-episode, or of a group of them, is not in [0, 1].
    """
    answer = values.copy()
    for name in values["metric"].unique():
        measure = METRICS[name]
        if not (is_own_name(name) and measure.is_share):
            continue
        own = values["metric"] == name
        rows = table.loc[table["agents"] > 0].reindex(columns=[*measure.needs])
        with np.errstate(all="ignore"):
            each = measure.of_whole({column: rows[column].to_numpy(float) for column in rows})
        found = np.concatenate([each, values.loc[own, "value"].to_numpy(float)])
        if ((found < 0.0) | (found > 1.0)).any():
            answer.loc[own, ["low", "high"]] = math.nan
            notes = answer.loc[own, "note"]
            answer.loc[own, "note"] = ["; ".join(filter(None, (note, NO_SHARE))) for note in notes]
    return answer


def as_csv(table: pd.DataFrame) -> str:
    """Return a table as files have it, with numbers by `csv_number`."""
    return table.to_csv(index=False, float_format=csv_number, lineterminator="\n")


def csv_number(number: float) -> str:
    """Return a number as CSV files have it: six figures, and no negative zero."""
    return f"{number:z.6g}"


def p_text(value: float) -> str:
    """Return a p-value as it is shown everywhere, empty without one."""
    if not math.isfinite(value):
        return ""
    return f"{value:.3f}" if value >= LEAST_P else f"< {LEAST_P:g}"


def by_key(rows: Frame) -> dict[Key, Value]:
    """Return the values of `measure_conditions` by algorithm, task, traffic, mode and metric."""
    found: dict[Key, Value] = {}
    records: list[dict[str, Any]] = rows.to_dict("records")
    for row in records:
        key = row["algorithm"], row["task"], row["traffic"], row["mode"], row["metric"]
        found[key] = Value(*(row[each.name] for each in fields(Value)))
    return found
