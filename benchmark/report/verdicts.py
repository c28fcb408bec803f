"""Verdicts of checks: a condition holds, does not hold, or is not known."""

from __future__ import annotations

from collections.abc import Iterable

from benchmark.statistics import Difference

MOST_P = 0.01
VERDICTS = {True: "passes", False: "FAILS", None: "not known"}


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
