"""Comparisons of algorithms in a condition, and their ranks."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtr, stdtrit

from benchmark.experiment.runs import SCRIPTED, SCRIPTED_SEED
from benchmark.metrics import METRICS, compare
from benchmark.metrics.results import Frame
from benchmark.metrics.table import sums_of
from benchmark.statistics import LEVEL, holm

RANKED_BY = ("completion_rate", "collision_rate")
"""The second one decides where the first is a tie."""
CONDITION = ("task", "task_traffic")
"""Columns of a table of agent-episodes that make a condition."""
COLUMNS = (
    *CONDITION,
    *("metric", "first", "second", "value", "low", "high", "p_value", "pairs", "corrected", "wins", "note"),
)


@dataclass(frozen=True)
class Standing:
    """Standing of an entry in a condition."""

    rank: int | None
    """None without another one to compare it with."""
    is_tied: bool
    """Whether one of the same rank is neither better nor worse."""


UNRANKED = Standing(None, is_tied=False)


def differences(
    table: Frame,
    mode: str,
    metrics: Sequence[str] = RANKED_BY,
    column: str = "algorithm",
    within: Sequence[str] = CONDITION,
) -> Frame:
    """Return differences at equal starts in every condition.

    P-values are corrected after Holm over the table: all conditions, metrics and pairs of learning
    algorithms; scripted policies against learning algorithms are a family of their own.

    Args:
        table: Agent-episodes of several algorithms.
        mode: Way of acting.
        metrics: Names.
        column: Name of the algorithm column.
        within: Columns whose values pairs have in common; those of the condition are among them.

    Returns:
        Of `benchmark.metrics.compare`, with `COLUMNS`.
    """
    if not len(table):
        return pd.DataFrame(columns=[*COLUMNS])
    kept: Frame = table[(table["split"] != "held_out") & table["mode"].isin([mode, SCRIPTED])]
    scripted: Any = set(kept.loc[kept["training_seed"] == SCRIPTED_SEED, column])
    return compare(kept, [*metrics], [*within], column, family=(), apart=scripted)[[*COLUMNS]]


def ranks(differing: Frame, entries: Sequence[Hashable]) -> dict[Hashable, Standing]:
    """Return how entries stand in one condition; a rank is one more than the number of better entries.

    One is better than another by its completion rate, or by its collision rate where completion is a tie. So
    entries between which nothing is decided, and than which the same others are better, have the same rank.
    An entry without a comparison has no rank.

    Args:
        differing: Result of `differences`, of one condition.
        entries: Entries to rank.
    """
    decided = _decided(differing, entries)
    undecided: dict[Hashable, set[Hashable]] = {entry: set() for entry in entries}
    better = dict.fromkeys(entries, 0)
    for (first, second), wins in decided.items():
        winner = next(filter(None, map(wins.get, RANKED_BY)), None)
        if winner is None:
            undecided[first].add(second)
            undecided[second].add(first)
        else:
            better[second if winner == first else first] += 1
    met = {entry for pair in decided for entry in pair}
    return {
        entry: Standing(1 + better[entry], any(better[other] == better[entry] for other in undecided[entry]))
        for entry in entries
        if entry in met or len(entries) == 1
    }


def _decided(
    differing: Frame, entries: Sequence[Hashable]
) -> dict[tuple[Hashable, Hashable], dict[str, Any]]:
    """Return for each pair of entries that could be compared the winner ("" for a tie) by metric."""
    found: dict[tuple[Hashable, Hashable], dict[str, Any]] = {}
    for row in differing.to_dict("records"):
        pair = row["first"], row["second"]
        if {*pair} <= {*entries} and not math.isnan(row["corrected"]):
            found.setdefault(pair, {})[row["metric"]] = row["wins"]
    return found


def of_condition(differing: Frame, task: str, traffic: str) -> Frame:
    """Return the differences in one condition."""
    return differing[(differing["task"] == task) & (differing["task_traffic"] == traffic)]


Floats = NDArray[np.float64]

LEAST_SEEDS = 3
"""Least number of seeds of either algorithm."""
SEED_COLUMNS = ("seeds_low", "seeds_high", "seeds_p_value", "seeds_corrected")


@dataclass(frozen=True)
class SeedDifference:
    """Mean over the first's training seeds minus that over the second's."""

    value: float
    error: float
    """Standard error; 0 where all seeds of each agree."""
    freedom: float
    """Degrees of freedom of Student's t."""

    def reach(self, level: float = LEVEL) -> float:
        """Return half the width of the two-sided interval."""
        return float(stdtrit(self.freedom, (1 + level) / 2)) * self.error


def welch(first: ArrayLike, second: ArrayLike) -> SeedDifference:
    """Return the difference of two samples of training seeds, whose variances may differ.

    Args:
        first: Value of each seed, shape (S,); S at least 2.
        second: The same, of any number of seeds from 2.

    Source: Welch, The generalization of Student's problem when several different population variances are
    involved, Biometrika 34 (1947).
    """
    both = [np.asarray(each, float) for each in (first, second)]
    parts = np.array([_variance(each) / len(each) for each in both])
    least = np.array([len(each) - 1 for each in both])
    freedom = parts.sum() ** 2 / (parts**2 / least).sum() if parts.any() else least.sum()
    return SeedDifference(float(both[0].mean() - both[1].mean()), float(np.sqrt(parts.sum())), float(freedom))


def _variance(sample: Floats) -> float:
    """Return the variance, 0 of equal values, whose mean may be rounded to another number."""
    return 0.0 if (sample == sample[0]).all() else float(sample.var(ddof=1))


def with_seed_differences(found: Frame, table: Frame, mode: str) -> Frame:
    """Return differences with `SEED_COLUMNS`: the same by training seeds, NaN where they are few.

    Welch's t on the values of training seeds. Seeds that agree are no evidence of low variance, so the
    interval is at least as wide as that over starts, and the p-value at least as large. Intervals of shares
    of counts are cut to [-1, 1]. P-values are corrected after Holm over all rows that have one.

    Args:
        found: Result of `benchmark.report.ranking.differences`, of learning algorithms and scripted policies.
        table: Agent-episodes of all of them.
        mode: Way of acting of the learning algorithms.
    """
    values: dict[tuple[str, ...], Floats] = {}
    is_kept = (table["split"] != "held_out") & (table["mode"] == mode) & ~table["is_invalid"]
    kept: Frame = table[is_kept]
    for metric in found["metric"].unique():
        measure = METRICS[metric]
        keys = ["task", "task_traffic", "algorithm", "training_seed"]
        sums: Frame = sums_of(kept, measure.needs, [kept[key] for key in keys])
        totals = {name: sums[name].to_numpy(float) for name in sums}
        places: Any = pd.Series(measure.of_whole(totals), sums.index).groupby(keys[:3])
        values |= {(metric, *place): each.to_numpy(float) for place, each in places}
    rows = [_by_seeds(row, values) for row in found.to_dict("records")]
    answer = found.assign(
        **{name: [row[number] for row in rows] for number, name in enumerate(SEED_COLUMNS[:3])}
    )
    return answer.assign(seeds_corrected=holm(answer["seeds_p_value"].to_numpy(float)))


def _by_seeds(row: dict[str, Any], values: dict[tuple[str, ...], Floats]) -> tuple[float, float, float]:
    """Return ends of the interval, and p-value."""
    place = row["metric"], row["task"], row["task_traffic"]
    both = [values.get((*place, row[name]), np.zeros(0)) for name in ("first", "second")]
    is_known = math.isfinite(row["p_value"]) and all(np.isfinite(each).all() for each in both)
    if not is_known or min(map(len, both)) < LEAST_SEEDS:
        return math.nan, math.nan, math.nan
    found = welch(*both)
    if found.error == 0.0:
        return math.nan, math.nan, math.nan
    reach, most = found.reach(), 1.0 if METRICS[row["metric"]].hits else math.inf
    low = max(min(found.value - reach, row["low"]), -most)
    high = min(max(found.value + reach, row["high"]), most)
    p_value = 2.0 * float(stdtr(found.freedom, -abs(found.value) / found.error))
    return low, high, max(p_value, row["p_value"])
