"""The look of the plots: the same colour for an algorithm of the registry in every report."""

from __future__ import annotations

from collections.abc import Sequence

from algorithms.registry import ALGORITHMS
from benchmark.report.paper import paper

PALETTE = (
    *("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#8c6d00", "#56b4e9", "#5b3fa0"),
    *("#e69f00", "#7f7f7f", "#b2182b", "#1b7837", "#2d2d2d"),
)
"""Okabe and Ito's colours for the paper's seven, told apart by the colour-blind, then others."""
DASHES = ("none", "8 2.4", "2.4 2", "8 2 2 2")
"""Dashes of lines as SVG has them; the next ones each time the colours repeat."""
OUTCOME_COLOURS = {
    "completion_rate": "#3a9d5d",
    "collision_rate": "#c8372d",
    "ended_off_road": "#e08214",
    "ended_off_route": "#f1b656",
    "ended_missed_goal": "#8073ac",
    "ended_not_moving": "#7fa6c9",
    "ended_time_out": "#9a9a9a",
    "ended_other": "#c9c9c9",
    "ended_other_terminal": "#a8876b",
    "ended_left_bubble": "#56b4a9",
}


def look(name: str, among: Sequence[str] = ()) -> tuple[int, str]:
    """Return the index of an algorithm's colour in `PALETTE`, and its dashes.

    Args:
        name: Name of the algorithm.
        among: All algorithms of the report; unregistered ones get the colours after the registered ones.
    """
    known = [*dict.fromkeys([*paper()["algorithms"], *ALGORITHMS, *among])]
    turn, number = divmod(known.index(name), len(PALETTE))
    return number, DASHES[turn % len(DASHES)]


def thousands(steps: float) -> str:
    """Return a number of steps in thousands or millions."""
    if steps >= 1_000_000:
        return f"{steps / 1_000_000:.3g} M"
    return f"{steps / 1000:.3g} k" if steps >= 1000 else f"{steps:g}"
