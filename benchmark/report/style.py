"""The look of the plots: the same colour for an algorithm of the registry in every report."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

from algorithms.registry import ALGORITHMS
from benchmark.report.paper import paper

PALETTE = (
    *("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#8c6d00", "#56b4e9", "#5b3fa0"),
    *("#e69f00", "#7f7f7f", "#b2182b", "#1b7837", "#2d2d2d"),
)
"""Okabe and Ito's colours for the paper's seven, told apart by the colour-blind, then others."""
DASHES = ("-", (0, (4, 1.2)), (0, (1.2, 1)), (0, (4, 1, 1, 1)))
"""Line styles."""
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
TEXT: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Arial", "sans-serif"],
    "font.size": 8.5,
    "axes.titlesize": 9.5,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
}
DOTS_PER_INCH = 150


def _number(name: str, among: Sequence[str] = ()) -> int:
    """Return an algorithm's index for colours: of the registry, then of other algorithms in the report."""
    known = dict.fromkeys([*paper()["algorithms"], *ALGORITHMS, *among])
    return [*known].index(name)


def colour_number(name: str, among: Sequence[str] = ()) -> int:
    """Return the index of an algorithm's colour in `PALETTE`.

    Args:
        name: Name of the algorithm.
        among: All algorithms of the report.
    """
    return _number(name, among) % len(PALETTE)


def line(name: str, among: Sequence[str] = ()) -> dict[str, Any]:
    """Return how matplotlib draws an algorithm's line; see `colour_number`."""
    shade = PALETTE[colour_number(name, among)]
    # Other dashes beside each other, for print, and the next ones each time the colours repeat.
    dashes = DASHES[(colour_number(name, among) + _turn(name, among)) % len(DASHES)]
    return {"color": shade, "linestyle": dashes, "linewidth": 1.6}


def dash(name: str, among: Sequence[str] = ()) -> str:
    """Return an algorithm's dashes as SVG has them; "none" until its colours repeat."""
    given = DASHES[_turn(name, among)]
    return "none" if isinstance(given, str) else " ".join(f"{2 * each:g}" for each in given[1])


def _turn(name: str, among: Sequence[str]) -> int:
    """Return how often the colours have repeated before an algorithm's."""
    return _number(name, among) // len(PALETTE) % len(DASHES)


def thousands(steps: float, _: Any = None) -> str:
    """Return a number of steps in thousands or millions; also as matplotlib asks for a tick's text."""
    if steps >= 1_000_000:
        return f"{steps / 1_000_000:.3g} M"
    return f"{steps / 1000:.3g} k" if steps >= 1000 else f"{steps:g}"


def new_figure(width: float, height: float) -> Any:
    """Return an empty figure that belongs to no window.

    Args:
        width: Width in inches.
        height: Height in inches.
    """
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def png(figure: Any) -> bytes:
    """Return a figure as a PNG file, without transparency.

    With all its colours: a palette that is found by counting takes from lines that are seldom seen theirs.
    """
    from PIL import Image

    drawn, out = io.BytesIO(), io.BytesIO()
    figure.savefig(drawn, format="png", dpi=DOTS_PER_INCH)
    Image.open(drawn).convert("RGB").save(out, format="png", optimize=True)
    return out.getvalue()
