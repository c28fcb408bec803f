"""Learning curves: return, completion and collision over agent-steps, with the seeds' band."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.metrics.results import Frame
from benchmark.report.content import Report
from benchmark.report.paper import algorithm_label
from benchmark.report.style import line, thousands

Floats = NDArray[np.float64]

SHOWN = ("return", "completion", "collision")
"""Columns of progress.csv, one below the other."""
TITLES = {"return": "Return", "completion": "Completion rate", "collision": "Collision rate"}
POINTS = 120
"""Number of points of a curve: as fine as can be seen."""


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


def draw_curves(panels: Sequence[Any], report: Report, task: str, traffic: str) -> None:
    """Draw a cell's curves of all algorithms: mean over seeds, band from the lowest to the highest seed.

    Dots are validations, each of one seed.

    Args:
        panels: Axes of matplotlib, one for each of `SHOWN`.
        report: Report with the runs.
        task: Task of the condition.
        traffic: Traffic of the condition.
    """
    for algorithm in report.algorithms:
        runs = runs_of(report, algorithm, task, traffic)
        for axes, column in zip(panels, SHOWN, strict=True):
            _draw(axes, runs, column, algorithm, line(algorithm, report.algorithms))
    for axes, column in zip(panels, SHOWN, strict=True):
        axes.set_ylabel(TITLES[column])
        axes.grid(color="#e3e3e3", linewidth=0.6)
        if column != "return":
            axes.set_ylim(-0.02, 1.02)
    panels[-1].set_xlabel("Agent-steps")
    for axes in panels:
        axes.set_xlim(left=0)
        axes.xaxis.set_major_formatter(thousands)


def _draw(axes: Any, runs: Sequence[Frame], column: str, algorithm: str, how: dict[str, Any]) -> None:
    steps, rows = seeds_curve(runs, column)
    if len(steps):
        # Where a seed is not there the mean is of something else, so there is none.
        axes.plot(steps, rows.mean(axis=0), label=algorithm_label(algorithm), **how)
        if len(rows) > 1:
            axes.plot(steps, rows.T, color=how["color"], linewidth=0.5, alpha=0.6)
            low, high = np.fmin.reduce(rows), np.fmax.reduce(rows)
            axes.fill_between(steps, low, high, color=how["color"], alpha=0.15, linewidth=0)
    for run in runs:
        validations = points(run, f"validation_{column}")
        axes.plot(*validations, ".", color=how["color"], markersize=4, alpha=0.8)
