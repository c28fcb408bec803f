"""The look of the plots: the same colour for an algorithm of the registry in every report."""

from __future__ import annotations

import base64
import io
import re
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
"""Line styles, of which colours that are alike in print have different ones."""
OUTCOME_COLOURS = {
    "completion_rate": "#3a9d5d",
    "collision_rate": "#c8372d",
    "ended_off_road": "#e08214",
    "ended_off_route": "#f1b656",
    "ended_missed_goal": "#8073ac",
    "ended_not_moving": "#7fa6c9",
    "ended_time_out": "#9a9a9a",
    "ended_other": "#c9c9c9",
    "ended_other_terminal": "#5d4a3a",
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
    "svg.fonttype": "none",
    "svg.hashsalt": "smarts-bench",
}
DOTS_PER_INCH = 150
PAGE_DOTS_PER_INCH = 115
_LONG_NUMBER = re.compile(r"(\d\.\d\d)\d+")
"""Coordinates to a hundredth of a point are finer than any screen."""


def _number(name: str, among: Sequence[str] = ()) -> int:
    """Return an algorithm's index for colours: of the registry, then of other algorithms in the report."""
    known = dict.fromkeys([*paper()["algorithms"], *ALGORITHMS, *among])
    return [*known].index(name)


def colour(name: str, among: Sequence[str] = ()) -> str:
    """Return the colour of an algorithm.

    Args:
        name: Name of the algorithm.
        among: All algorithms of the report.
    """
    return PALETTE[_number(name, among) % len(PALETTE)]


def line(name: str, among: Sequence[str] = ()) -> dict[str, Any]:
    """Return how matplotlib draws an algorithm's line; see `colour`."""
    shade = colour(name, among)
    return {"color": shade, "linestyle": DASHES[_dash(name, among)], "linewidth": 1.6}


def dash(name: str, among: Sequence[str] = ()) -> str:
    """Return an algorithm's dashes as SVG has them; see `colour`."""
    given = DASHES[_dash(name, among)]
    return "none" if isinstance(given, str) else " ".join(f"{2 * each:g}" for each in given[1])


def _dash(name: str, among: Sequence[str] = ()) -> int:
    # The next dashes each time the colours repeat.
    turn, place = divmod(_number(name, among), len(PALETTE))
    return (place + turn) % len(DASHES)


def new_figure(width: float, height: float) -> Any:
    """Return an empty figure that belongs to no window.

    Args:
        width: Width in inches.
        height: Height in inches.
    """
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def as_lines(figure: Any) -> str:
    """Return a figure as the source of an image in a page: lines and text, for what has few of them."""
    out = io.StringIO()
    nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    figure.savefig(out, format="svg", metadata=nothing)
    text = out.getvalue()
    text = _LONG_NUMBER.sub(r"\1", text[text.index("<svg") :])
    return "data:image/svg+xml;base64," + base64.b64encode(text.encode()).decode()


def as_dots(figure: Any) -> str:
    """Return a figure as the source of an image in a page: pixels, for what has thousands of points."""
    return data_uri(png(figure, PAGE_DOTS_PER_INCH))


def data_uri(picture: bytes) -> str:
    """Return a PNG file as the source of an image in a page."""
    return "data:image/png;base64," + base64.b64encode(picture).decode()


def png(figure: Any, dots_per_inch: int = DOTS_PER_INCH) -> bytes:
    """Return a figure as a PNG file, without transparency.

    With all its colours: a palette that is found by counting takes from lines that are seldom seen theirs.
    """
    from PIL import Image

    drawn, out = io.BytesIO(), io.BytesIO()
    figure.savefig(drawn, format="png", dpi=dots_per_inch)
    Image.open(drawn).convert("RGB").save(out, format="png", optimize=True)
    return out.getvalue()
