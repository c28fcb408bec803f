"""Summaries over conditions: interquartile mean, performance profile, probability of improvement.

The unit is a training seed in a condition; its scores are its completion and its non-collision rate.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.metrics.results import Frame
from benchmark.report.content import Report
from benchmark.report.paper import algorithm_label, condition_label
from benchmark.statistics import (
    interquartile_mean,
    probability_of_improvement,
    stratified_interval,
)
from smarts.types.streams import Purpose, stream

Floats = NDArray[np.float64]

SCORES = {"completion": ("goals", False), "no collision": ("collisions", True)}
"""Score -> its column of counts, and whether it is 1 minus their share."""
COLUMNS = {
    "algorithm": "Of all conditions of the table",
    "IQM of completion": "Interquartile mean over training seeds and conditions",
    "IQM of no collision": "Of 1 - collision rate",
    "seeds x conditions": "How many scores there are",
}
IMPROVEMENT_COLUMNS = {
    "first": "X",
    "second": "Y",
    "P(X > Y)": "That a training seed of X completes more in a condition than one of Y, mean over conditions",
}
NOTE = (
    "Over all conditions, of the training seeds that an algorithm has finished in each of them. "
    "95% intervals: 2,000 resamples of training seeds within each condition (rliable's definitions, Agarwal "
    "et al., 2021). With two seeds a condition has three distinct resamples, with three it has ten: such "
    "intervals are too narrow, and of no width where seeds agree; with one seed there is none. IQM: "
    "interquartile mean."
)


@dataclass(frozen=True)
class Summaries:
    """Scores of the algorithms that have finished all conditions with the same seeds, by such seeds."""

    scores: dict[str, dict[str, Floats]]
    """Score -> algorithm -> values, shape (seeds, conditions)."""
    apart: Sequence[tuple[str, str]] = ()
    """Pairs of algorithms that have different protocols in a condition."""
    left_out: Sequence[str] = ()
    """Algorithms with runs that must not be averaged or compared, each with condition and reason."""

    @property
    def algorithms(self) -> list[str]:
        """Names."""
        return [*self.scores["completion"]]

    @property
    def note(self) -> str:
        """What the tables say, and what was left out of them."""
        out = f" Left out: {'; '.join(self.left_out)}." if self.left_out else ""
        apart = "; ".join(" and ".join(map(algorithm_label, pair)) for pair in self.apart)
        return NOTE + out + (f" Of different protocols, and not to be compared: {apart}." if apart else "")

    def mean_rows(self) -> list[list[str]]:
        """Return a row for each algorithm, with `COLUMNS`."""
        rows = []
        for name in self.algorithms:
            values = [self.scores[score][name] for score in SCORES]
            texts = [_with_interval(interquartile_mean, each) for each in values]
            rows.append([algorithm_label(name), *texts, f"{values[0].shape[0]} x {values[0].shape[1]}"])
        return rows

    def improvement_rows(self) -> list[list[str]]:
        """Return a row for each pair, with `IMPROVEMENT_COLUMNS`."""
        found = self.scores["completion"]
        return [
            [
                *map(algorithm_label, pair),
                "n/a: different protocols"
                if pair in self.apart
                else _with_interval(probability_of_improvement, *(found[name] for name in pair))
                if min(len(found[name]) for name in pair) > 1
                else "n/a: one seed",
            ]
            for pair in itertools.combinations(found, 2)
        ]


def summaries_of(report: Report) -> Summaries:
    """Return the summaries of a report's main mode."""
    table = report.results.table
    kept: Frame = (
        table[(table["split"] != "held_out") & (table["mode"] == report.modes[0])] if len(table) else table
    )
    found: dict[str, dict[str, Floats]] = {score: {} for score in SCORES}
    left_out = [
        f"{algorithm_label(name)} ({condition_label(task, traffic)}: {reason})"
        for (name, task, traffic), reason in report.unlike.items()
        if name in report.algorithms
    ]
    unlike = {name for name, *_ in report.unlike}
    for name in report.algorithms if len(kept) else ():
        if name in unlike:
            continue
        for score, (column, is_loss) in SCORES.items():
            values = _by_seed_and_condition(kept[kept["algorithm"] == name], column, report.columns)
            if values is not None:
                found[score][name] = 1.0 - values if is_loss else values
    apart = [
        (first, second)
        for first, second in itertools.combinations(found["completion"], 2)
        if any(report.protocols[first, *cell] != report.protocols[second, *cell] for cell in report.columns)
    ]
    return Summaries(found, apart, left_out)


def _by_seed_and_condition(rows: Frame, column: str, cells: list[tuple[str, str]]) -> Floats | None:
    """Return a rate of each seed that has finished all conditions, in each of them, shape (S, M), or None."""
    sums = (
        rows[~rows["is_invalid"]].groupby(["training_seed", "task", "task_traffic"])[[column, "agents"]].sum()
    )
    rates = (sums[column] / sums["agents"]).unstack(["task", "task_traffic"])
    found: Floats = rates.reindex(columns=cells).dropna().to_numpy(float)
    return found if found.size else None


def _with_interval(statistic: Any, *scores: Floats) -> str:
    value = statistic(*scores)
    if min(map(len, scores)) < 2:
        return f"{value:.2f}"
    low, high = stratified_interval(statistic, stream(0, Purpose.RESAMPLING), *scores)
    return f"{value:.2f} [{low:.2f}, {high:.2f}]"
