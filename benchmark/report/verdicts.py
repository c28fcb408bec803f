"""Verdicts of checks of scripted policies: a condition holds, does not hold, or is not known."""

from __future__ import annotations

from collections.abc import Iterable

from benchmark.metrics.results import Frame
from benchmark.metrics.table import EPISODE_KEYS
from benchmark.results.reading import RunResult
from benchmark.statistics import Difference, paired_difference

RULE_BASED = "gap_acceptance"
LEAST_DIFFERENCE = 0.10
MOST_P = 0.01
VERDICTS = {True: "passes", False: "FAILS", None: "not known"}


def tested_rows(run: RunResult) -> Frame:
    """Return the agent-episodes of a finished test that are neither invalid nor held out."""
    table: Frame = run.table
    return table[(table["split"] == "train") & ~table["is_invalid"] & (table["agents"] > 0)]


def difference_of(one: RunResult, other: RunResult, column: str) -> Difference | None:
    """Return the mean difference of a column over the episodes that both played, whatever their traffic.

    Returns:
        None if it was not measured.
    """
    tables = [tested_rows(run) for run in (one, other)]
    if not all(column in table for table in tables):
        return None
    keys = [name for name in EPISODE_KEYS if name != "traffic"]
    first, second = (table.groupby(keys)[column].mean() for table in tables)
    is_share = column in ("goals", "collisions")
    return paired_difference((first - second).dropna().to_numpy(float), is_share_of_counts=is_share)


def all_hold(conditions: Iterable[bool | None]) -> bool | None:
    """Return False if a condition does not hold, else None if one is not known, else True."""
    found = set(conditions)
    if False in found:
        return False
    return None if None in found else True


def is_at_least(difference: Difference, least: float) -> bool | None:
    """Return whether a difference is as large as asked for.

    Args:
        difference: Over common episodes.
        least: Bound of its value.

    Returns:
        True if its value reaches the bound and p < 0.01, False if its 95% interval ends below the bound, else
        None; with fewer than two common episodes, too.
    """
    if difference.value >= least and difference.p_value < MOST_P:
        return True
    return False if difference.high < least else None


def is_positive(difference: Difference) -> bool | None:
    """Return True if a difference is above 0 with p < 0.01, False if it is not above 0, else None."""
    if difference.value <= 0.0:
        return False
    return True if difference.p_value < MOST_P else None


def shown_p(difference: Difference) -> str:
    """Return the p-value and the number of episodes as text."""
    p_value = difference.p_value
    known = "no p" if p_value != p_value else "p < 0.001" if p_value < 0.001 else f"p = {p_value:.3f}"
    return f"{known}, {difference.pairs} episodes"
