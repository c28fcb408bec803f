"""The page's plots as paths of SVG: curves in a square that the page stretches, radars around (0, 0).

The page has SVG, which takes its colours, width and marks from the page; report.md has PNG, which every
reader of Markdown shows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmark.report.content import Report
from benchmark.report.curves import TITLES, points, runs_of, seeds_curve
from benchmark.report.paper import algorithm_label
from benchmark.report.radar import axis_label, radius_of
from benchmark.report.style import colour_number, dash, thousands
from benchmark.report.summary import THRESHOLDS, Summaries
from benchmark.statistics import performance_profile

Floats = NDArray[np.float64]
Ticks = list[tuple[float, str]]
"""Place as a share of the axis from its origin, and text."""

SIDE, RADIUS = 1000, 120
"""Width of the square of curves; radius of a radar's outer ring."""
MARGIN, LINE, SIGN = 11, 15, 6.8
"""Distance of a radar's labels from the ring, height of their lines, width of a sign."""
LEAST_TICKS = 3
"""Least number of ticks between ends that are round."""


@dataclass(frozen=True)
class Series:
    """How the page shows an algorithm in all plots."""

    number: int
    """Index of its colour."""
    dash: str
    label: str


@dataclass(frozen=True)
class Panel:
    """Curves with the ticks of both axes."""

    title: str
    curves: list[tuple[Series, str, str, str, str]]
    """Paths of the mean, of each seed, of the band and of dots, which are lines of no length."""
    across: Ticks
    up: Ticks


def series_of(report: Report) -> dict[str, Series]:
    """Return how each learning algorithm is shown."""
    every = report.algorithms
    return {
        name: Series(colour_number(name, every), dash(name, every), algorithm_label(name)) for name in every
    }


def curves(report: Report, task: str, traffic: str, column: str) -> Panel | None:
    """Return the learning curves of a condition; None where no training has a value.

    Args:
        report: Report with the runs.
        task: Task of the condition.
        traffic: Traffic of the condition.
        column: Column of progress.csv, one of `benchmark.report.curves.TITLES`.
    """
    runs = {name: runs_of(report, name, task, traffic) for name in report.algorithms}
    lines = {name: line for name, each in runs.items() if len((line := seeds_curve(each, column))[0])}
    if not lines:
        return None
    dots = {name: np.hstack([points(run, f"validation_{column}") for run in runs[name]]) for name in lines}
    every = np.concatenate([x.ravel() for name in lines for x in (lines[name][1], dots[name][1])])
    ends = (np.nanmin(every), np.nanmax(every) + 1e-6) if column == "return" else (0.0, 1.0)
    most = max(steps[-1] for steps, _ in lines.values())
    drawn = []
    for name, (steps, rows) in lines.items():
        places = [_places(steps, row, most, ends) for row in (rows.mean(axis=0), *rows)]
        band = [_places(steps, row, most, ends) for row in (np.fmin.reduce(rows), np.fmax.reduce(rows))]
        several = len(rows) > 1
        drawn.append(
            (
                series_of(report)[name],
                path(places[0], 0),
                "".join(path(each, 0) for each in places[1:]) if several else "",
                path(np.append(band[0], band[1][::-1], axis=0), 0) if several else "",
                "".join(f"M{x:.0f} {y:.0f}h0" for x, y in _places(dots[name][0], dots[name][1], most, ends)),
            )
        )
    across = [(tick / most, thousands(tick)) for tick in ticks(0.0, most)]
    up = [((tick - ends[0]) / (ends[1] - ends[0]), f"{tick:g}") for tick in ticks(*ends)]
    return Panel(TITLES[column], drawn, across, up)


def profile(summaries: Summaries, report: Report) -> Panel:
    """Return the performance profile of completion."""
    drawn = []
    for name, values in summaries.scores["completion"].items():
        shares = performance_profile(values, THRESHOLDS)
        drawn.append((series_of(report)[name], path(_places(THRESHOLDS, shares, 1.0, (0, 1)), 0), "", "", ""))
    rates = [(tick, f"{tick:g}") for tick in ticks(0.0, 1.0)]
    return Panel("Share of runs with a higher completion rate", drawn, rates, rates)


def radar(report: Report, task: str, traffic: str, names: Sequence[str]) -> list[tuple[Series, str]]:
    """Return the line of each algorithm in a condition's radar, with a gap where a metric is n/a.

    Args:
        report: Report with the values; those of its main mode are drawn.
        task: Task of the condition.
        traffic: Traffic of the condition.
        names: Metrics, an axis from 0 to 1 each.
    """
    drawn = []
    for algorithm, series in series_of(report).items():
        found = [report.value(algorithm, task, traffic, report.modes[0], name) for name in names]
        around = RADIUS * np.array([radius_of(value) for value in found])[:, None] * directions(names)
        drawn.append((series, path(np.append(around, around[:1], axis=0), 1)))
    return drawn


def directions(names: Sequence[str]) -> Floats:
    """Return where the axes of a radar point, the first one up, shape (N, 2)."""
    angles = np.linspace(0.0, 2 * np.pi, len(names), endpoint=False)
    return np.stack([np.sin(angles), -np.cos(angles)], axis=1)


def labels(names: Sequence[str]) -> list[tuple[float, float, str, list[str]]]:
    """Return place, anchor and lines of the labels at a radar's axes."""
    found = []
    for (x, y), name in zip(directions(names).tolist(), names, strict=True):
        text = axis_label(name)
        lines = text.rsplit(" ", 1) if len(text) > 12 else [text]
        top = (RADIUS + MARGIN) * y + LINE * (0.3 + (len(lines) - 1) * (min(0.0, y) - 0.5) * 0.8)
        anchor = ("end", "middle", "start")[1 + round(x * 1.2)]
        found.append((round((RADIUS + MARGIN) * x, 1), round(top, 1), anchor, lines))
    return found


def ticks(low: float, high: float) -> list[float]:
    """Return round numbers between two ends, in as many steps as are easy to read."""
    unit = 10 ** math.floor(math.log10((high - low) / LEAST_TICKS))
    step = next(n * unit for n in (5, 2, 1) if (high - low) / (n * unit) >= LEAST_TICKS - 1)
    return [round(n * step, 9) for n in range(math.ceil(low / step), math.floor(high / step) + 1)]


def path(places: Floats, digits: int) -> str:
    """Return a line through places, shape (P, 2); it begins again behind each that is NaN."""
    parts, sign = [], "M"
    for x, y in places.tolist():
        is_known = math.isfinite(x) and math.isfinite(y)
        parts.append(f"{sign}{x:.{digits}f} {y:.{digits}f}" if is_known else "")
        sign = "L" if is_known else "M"
    return "".join(parts)


def _places(steps: Floats, values: Floats, most: float, ends: tuple[float, float]) -> Floats:
    """Return places in the square, shape (P, 2), whose vertical axis points down."""
    return SIDE * np.stack([steps / most, (ends[1] - values) / (ends[1] - ends[0])], axis=1)
