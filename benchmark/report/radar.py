"""Radar plots on fixed scales from 0 to 1: the paper's four behaviour metrics, and all of its indices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmark.metrics import METRICS
from benchmark.report.content import Report
from benchmark.report.style import line
from benchmark.report.values import Value

RINGS = (0.25, 0.5, 0.75, 1.0)
NAMED_RINGS = (0.5, 1.0)


def axes_of_radar() -> list[str]:
    """Return the metrics that are axes of the paper's radars."""
    return [name for name in METRICS if METRICS[name].is_axis]


def draw_radar(axes: Any, report: Report, task: str, traffic: str, *, names: Sequence[str]) -> None:
    """Draw all algorithms of a cell over each other; where a metric is n/a its line has a gap.

    Of metrics that are better when lower, 1 minus the value is drawn.

    Args:
        axes: Polar ones of matplotlib.
        report: Report with the values; those of its main mode are drawn.
        task: Task of the condition.
        traffic: Traffic of the condition.
        names: Metrics, an axis each.
    """
    angles = np.linspace(0.0, 2 * np.pi, len(names), endpoint=False)
    axes.set_theta_offset(np.pi / 2)
    axes.set_theta_direction(-1)
    axes.set_ylim(0.0, 1.0)
    axes.set_yticks(RINGS, [""] * len(RINGS))
    for ring in NAMED_RINGS:
        # Above the lines, which tick labels are not.
        box = {"facecolor": "white", "edgecolor": "none", "pad": 0.6, "alpha": 0.85}
        place = {"ha": "center", "va": "center", "zorder": 5}
        axes.text(np.pi / 4, ring, f"{ring:g}", fontsize=6.5, color="#555555", bbox=box, **place)
    axes.set_xticks(angles, [axis_label(name) for name in names])
    axes.tick_params(axis="x", pad=9 if len(names) <= 4 else 2)
    if len(names) > 4:
        for text, angle in zip(axes.get_xticklabels(), angles, strict=True):
            text.set_horizontalalignment(("right", "center", "left")[1 + round(float(np.sin(angle)))])
            text.set_fontsize(7)
    axes.grid(color="#d5d5d5", linewidth=0.6)
    axes.spines["polar"].set_color("#aaaaaa")
    for algorithm in report.algorithms:
        found = [report.value(algorithm, task, traffic, report.modes[0], name) for name in names]
        radii = [radius_of(value) for value in found]
        how = line(algorithm, report.algorithms)
        closed = np.append(radii, radii[0]), np.append(angles, 2 * np.pi)
        axes.plot(*closed[::-1], marker="o", markersize=3, clip_on=False, **how)


def axis_label(name: str) -> str:
    """Return what stands at a metric's axis."""
    text = METRICS[name].label.replace("Control d", "D")
    return f"1 - {text.lower()}" if METRICS[name].better == "lower" else text


def radius_of(value: Value | None) -> float:
    """Return where a value is on its axis, 1 minus it if lower is better; NaN where there is none."""
    if value is None:
        return float("nan")
    return 1.0 - value.value if METRICS[value.metric].better == "lower" else value.value
