"""Plots as paths of SVG: curves in a square that the page stretches, radars around (0, 0); shares of bars.

The page has them inside, and report.md as files beside it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from benchmark.metrics import METRICS
from benchmark.metrics.results import Frame
from benchmark.report.content import Report
from benchmark.report.paper import algorithm_label
from benchmark.report.style import look, thousands
from benchmark.report.summary import Summaries
from benchmark.report.values import OUTCOMES, Value
from benchmark.statistics import performance_profile, stratified_interval
from smarts.types.streams import Purpose, stream

Floats = NDArray[np.float64]
Ticks = list[tuple[float, str]]
"""Place as a share of the axis from its origin, and text."""

TITLES = {"return": "Return", "completion": "Completion rate", "collision": "Collision rate"}
"""Column of progress.csv -> title of its plot, one below the other."""
POINTS = 120
"""Number of points of a curve: as fine as can be seen."""
SHORT = {"completion_rate": "Goal", "collision_rate": "Collision"}
"""Names of the outcomes that the two rates are of."""
WHOLE = 0.99
"""Shares below add up to less than all outcomes."""
SIDE, RADIUS = 1000, 120
"""Width of the square of curves; radius of a radar's outer ring."""
MARGIN, LINE, SIGN = 11, 15, 6.8
"""Distance of a radar's labels from the ring, height of their lines, width of a sign."""
THRESHOLDS = np.linspace(0.0, 1.0, 101)
"""Completion rates at which performance profiles are drawn."""
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
    return {name: Series(*look(name, every), algorithm_label(name)) for name in every}


def curves(report: Report, task: str, traffic: str, column: str) -> Panel | None:
    """Return the learning curves of a condition; None where no training has a value.

    Args:
        report: Report with the runs.
        task: Task of the condition.
        traffic: Traffic of the condition.
        column: Column of progress.csv, one of `benchmark.report.drawing.TITLES`.
    """
    runs = {name: runs_of(report, name, task, traffic) for name in report.algorithms}
    lines = {name: line for name, each in runs.items() if len((line := seeds_curve(each, column))[0])}
    if not lines:
        return None
    dots = {name: np.hstack([points(run, f"validation_{column}") for run in runs[name]]) for name in lines}
    every = np.concatenate([x.ravel() for name in lines for x in (lines[name][1], dots[name][1])])
    ends = (np.nanmin(every), np.nanmax(every) + 1e-6) if column == "return" else (0.0, 1.0)
    most = max(steps[-1] for steps, _ in lines.values())
    shown = series_of(report)
    drawn = [(shown[name], *_paths(*line, dots[name], most, ends)) for name, line in lines.items()]
    across = [(tick / most, thousands(tick)) for tick in ticks(0.0, most)]
    up = [((tick - ends[0]) / (ends[1] - ends[0]), f"{tick:g}") for tick in ticks(*ends)]
    return Panel(TITLES[column], drawn, across, up)


def _paths(
    steps: Floats, rows: Floats, dots: Floats, most: float, ends: tuple[float, float]
) -> tuple[str, str, str, str]:
    """Return the paths of a curve, see `Panel`; of one seed, it has no curves beside the mean."""
    mean, *seeds = (path(_places(steps, row, most, ends), 0) for row in (rows.mean(axis=0), *rows))
    marks = "".join(f"M{x:.0f} {y:.0f}h0" for x, y in _places(dots[0], dots[1], most, ends))
    if len(rows) == 1:
        return mean, "", "", marks
    return mean, "".join(seeds), _band(steps, np.fmin.reduce(rows), np.fmax.reduce(rows), most, ends), marks


def profile(summaries: Summaries, report: Report) -> Panel:
    """Return the performance profile of completion."""
    drawn, ends = [], (0.0, 1.0)
    shares = partial(performance_profile, thresholds=THRESHOLDS)
    for name, values in summaries.scores["completion"].items():
        line, band = path(_places(THRESHOLDS, shares(values), 1.0, ends), 0), ""
        if len(values) > 1:
            reach = stratified_interval(shares, stream(0, Purpose.RESAMPLING), values, repeats=500)
            band = _band(THRESHOLDS, *reach, 1.0, ends)
        drawn.append((series_of(report)[name], line, "", band, ""))
    rates = [(tick, f"{tick:g}") for tick in ticks(*ends)]
    return Panel("Share of runs with a higher completion rate", drawn, rates, rates)


def axes_of_radar() -> list[str]:
    """Return the metrics that are axes of the paper's radars."""
    return [name for name in METRICS if METRICS[name].is_axis]


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
        around = RADIUS * np.array([_radius_of(value) for value in found])[:, None] * directions(names)
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
        text = _axis_label(name)
        lines = text.rsplit(" ", 1) if len(text) > 12 else [text]
        top = (RADIUS + MARGIN) * y + LINE * (0.3 + (len(lines) - 1) * (min(0.0, y) - 0.5) * 0.8)
        anchor = ("end", "middle", "start")[1 + round(x * 1.2)]
        found.append((round((RADIUS + MARGIN) * x, 1), round(top, 1), anchor, lines))
    return found


def half_width(names: Sequence[str]) -> float:
    """Return how far the labels of a radar reach to either side."""
    return RADIUS + MARGIN + SIGN * max(len(line) for *_, lines in labels(names) for line in lines)


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


def _band(steps: Floats, low: Floats, high: Floats, most: float, ends: tuple[float, float]) -> str:
    """Return the outline of a band between two lines."""
    along, back = _places(steps, low, most, ends), _places(steps, high, most, ends)
    return path(np.append(along, back[::-1], axis=0), 0)


def _axis_label(name: str) -> str:
    """Return what stands at a metric's axis."""
    text = METRICS[name].label.replace("Control d", "D")
    return f"1 - {text.lower()}" if METRICS[name].better == "lower" else text


def _radius_of(value: Value | None) -> float:
    """Return where a value is on its axis, 1 minus it if lower is better; NaN where there is none."""
    if value is None:
        return math.nan
    return 1.0 - value.value if METRICS[value.metric].better == "lower" else value.value


def seeds_curve(runs: Sequence[Frame], column: str) -> tuple[Floats, Floats]:
    """Return a column of several runs at common steps.

    Args:
        runs: Progress of each.
        column: Column of progress.csv.

    Returns:
        Agent-steps, shape (P,), and the column of each run there, shape (S, P), NaN where a run has not yet
        or no longer a value.
    """
    known = [each for run in runs if (each := points(run, column)).size]
    if not known:
        return np.zeros(0), np.zeros((0, 0))
    begin, end = min(each[0, 0] for each in known), max(each[0, -1] for each in known)
    steps = np.linspace(begin, end, POINTS)
    return steps, np.stack([np.interp(steps, *points, left=np.nan, right=np.nan) for points in known])


def runs_of(report: Report, algorithm: str, task: str, traffic: str) -> list[Frame]:
    """Return the progress of an algorithm's runs in a condition, finished or not."""
    place = algorithm, task, traffic
    return [
        run.progress
        for run in report.results.runs
        if (run.algorithm, run.task, run.traffic) == place and run.progress is not None
    ]


def points(run: Frame, column: str) -> Floats:
    """Return agent-steps and a column where it has a value, shape (2, N)."""
    steps, values = run["agent_steps"].to_numpy(float), run[column].to_numpy(float)
    known = np.isfinite(steps) & np.isfinite(values)
    return np.stack([steps[known], values[known]])


def outcome_label(name: str) -> str:
    """Return the name of a share's outcome."""
    return SHORT[name] if name in SHORT else METRICS[name].label


def shown_outcomes(report: Report) -> list[str]:
    """Return the outcomes with a share above 0, and the two rates."""
    rows = report.values
    seen = set(rows.loc[rows["value"] > 0, "metric"])
    return [name for name in OUTCOMES if name in seen or name in SHORT]


def shares(report: Report, name: str, task: str, traffic: str) -> dict[str, float]:
    """Return the share of each of `shown_outcomes` in the main mode, 0 where it is not known."""
    found = {
        outcome: report.value(name, task, traffic, report.modes[0], outcome)
        for outcome in shown_outcomes(report)
    }
    return {outcome: value.value if value and value.is_known else 0.0 for outcome, value in found.items()}


def missing(report: Report, name: str, task: str, traffic: str) -> str:
    """Return why shares add up to less than all outcomes, "" if they do not."""
    if sum(shares(report, name, task, traffic).values()) >= WHOLE:
        return ""
    is_finished = report.value(name, task, traffic, report.modes[0], "completion_rate") is not None
    return "not measured" if is_finished else "no finished run"
