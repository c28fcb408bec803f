"""Comparisons of algorithms in a cell, and their ranks."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from benchmark.experiment.runs import SCRIPTED, SCRIPTED_SEED
from benchmark.metrics import compare
from benchmark.metrics.results import Frame

RANKED_BY = ("completion_rate", "collision_rate")
"""The second one decides where the first is a tie."""
CELL = ("task", "task_traffic")
"""Columns of a table of agent-episodes that make a cell."""
COLUMNS = (
    *CELL,
    *("metric", "first", "second", "value", "low", "high", "p_value", "pairs", "corrected", "wins", "note"),
)


@dataclass(frozen=True)
class Standing:
    """Where an entry stands in a cell."""

    rank: int
    is_tied: bool
    """Whether one of the same rank is neither better nor worse."""


def differences(
    table: Frame,
    mode: str,
    metrics: Sequence[str] = RANKED_BY,
    column: str = "algorithm",
    within: Sequence[str] = CELL,
) -> Frame:
    """Return differences at equal starts in every cell.

    P-values are corrected after Holm over the table: all cells, metrics and pairs of learning algorithms;
    scripted policies against learning algorithms are a family of their own.

    Args:
        table: Agent-episodes of several algorithms.
        mode: Way of acting.
        metrics: Names.
        column: Name of the algorithm column.
        within: Columns whose values pairs have in common; those of the cell are among them.

    Returns:
        Of `benchmark.metrics.compare`, with `COLUMNS`.
    """
    if not len(table):
        return pd.DataFrame(columns=[*COLUMNS])
    kept: Frame = table[(table["split"] == "train") & table["mode"].isin([mode, SCRIPTED])]
    scripted: Any = set(kept.loc[kept["training_seed"] == SCRIPTED_SEED, column])
    return compare(kept, [*metrics], [*within], column, family=(), apart=scripted)[[*COLUMNS]]


def ranks(differing: Frame, entries: Sequence[Hashable]) -> dict[Hashable, Standing]:
    """Return how entries stand in one cell; a rank is one more than the number of those that are better.

    One is better than another by its completion rate, or by its collision rate where completion is a tie. So
    entries between which nothing is decided, and than which the same others are better, have the same rank.
    An entry without a comparison has no rank.

    Args:
        differing: Of `differences`, of one cell.
        entries: To be ranked.
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


def of_cell(differing: Frame, task: str, traffic: str) -> Frame:
    """Return the differences in one cell."""
    return differing[(differing["task"] == task) & (differing["task_traffic"] == traffic)]
