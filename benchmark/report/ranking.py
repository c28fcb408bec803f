"""Who is better than whom: paired differences, corrected over the table, and the ranks they allow."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Any

import numpy as np
import pandas as pd

from benchmark.metrics import METRICS, compare
from benchmark.metrics.results import Frame
from benchmark.report.data import SCRIPTED_SEED
from benchmark.report.values import SCRIPTED
from benchmark.statistics import holm

RANKED_BY = ("completion_rate", "collision_rate")
"""The second one decides where the first is a tie."""
CELL = ("task", "task_traffic")
"""Columns of a table of agent-episodes that make a cell."""
SIGNIFICANCE = 0.05
"""Of a corrected p-value, below which a difference is no tie."""
COLUMNS = (
    *CELL,
    *("metric", "first", "second", "value", "low", "high", "p_value", "pairs", "corrected", "wins"),
)


def differences(
    table: Frame, mode: str, metrics: Sequence[str] = RANKED_BY, column: str = "algorithm"
) -> Frame:
    """Return paired differences in every cell, Holm-corrected over all of them.

    A scripted policy, which has no training seed, stands beside each seed of the others; pairs of two
    scripted policies are left out.

    Args:
        table: Agent-episodes of several algorithms.
        mode: Way of acting.
        metrics: Names.
        column: That tells the algorithms apart.

    Returns:
        Of `benchmark.metrics.compare`, with `COLUMNS`.
    """
    if not len(table):
        return pd.DataFrame(columns=[*COLUMNS])
    kept: Frame = table[(table["split"] == "train") & table["mode"].isin([mode, SCRIPTED])]
    scripted: Any = set(kept.loc[kept["training_seed"] == SCRIPTED_SEED, column])
    answer: Frame = compare(beside_each_seed(kept), [*metrics], [*CELL], column)
    is_idle = answer["first"].isin(scripted) & answer["second"].isin(scripted)
    answer = answer[~is_idle].reset_index(drop=True)
    answer["corrected"] = holm(answer["p_value"].to_numpy(float))
    answer["wins"] = [_winner(row) for row in answer.to_dict("records")]
    return answer[[*COLUMNS]]


def ranks(differing: Frame, entries: Sequence[Hashable]) -> dict[Hashable, int]:
    """Return the rank of each entry in one cell: one more than the number of those that beat it.

    One beats another by its completion rate, or by its collision rate where completion is a tie. So entries
    between which nothing is decided, and that the same others beat, have the same rank.

    Args:
        differing: Of `differences`, of one cell.
        entries: Who is ranked.
    """
    beaten: dict[Hashable, int] = dict.fromkeys(entries, 0)
    wins = {(row["metric"], row["first"], row["second"]): row["wins"] for row in differing.to_dict("records")}
    for _, first, second in {("", pair[1], pair[2]) for pair in wins}:
        winner = next((wins[name, first, second] for name in RANKED_BY if wins[name, first, second]), "")
        loser = second if winner == first else first
        if winner and winner in beaten and loser in beaten:
            beaten[loser] += 1
    return {entry: 1 + count for entry, count in beaten.items()}


def of_cell(differing: Frame, task: str, traffic: str) -> Frame:
    """Return the differences in one cell."""
    return differing[(differing["task"] == task) & (differing["task_traffic"] == traffic)]


def beside_each_seed(table: Frame) -> Frame:
    """Return a table with the episodes of scripted policies once for each training seed of the others."""
    is_scripted = table["training_seed"] == SCRIPTED_SEED
    seeds = np.unique(table.loc[~is_scripted, "training_seed"].to_numpy()).tolist()
    if not seeds or not is_scripted.any():
        return table
    scripted = [table[is_scripted].assign(training_seed=seed) for seed in seeds]
    return pd.concat([table[~is_scripted], *scripted], ignore_index=True)


def _winner(row: dict[Any, Any]) -> str:
    better = METRICS[row["metric"]].better
    if better is None or not row["corrected"] < SIGNIFICANCE:
        return ""
    return row["first"] if (row["value"] > 0) == (better == "higher") else row["second"]
