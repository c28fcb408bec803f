"""Outcomes of agent-episodes as stacked bars."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmark.metrics import METRICS
from benchmark.report.content import Report
from benchmark.report.paper import algorithm_label
from benchmark.report.style import OUTCOME_COLOURS
from benchmark.report.values import OUTCOMES

SHORT = {"completion_rate": "Goal", "collision_rate": "Collision"}
"""Names of the outcomes that the two rates are of."""
LEAST_NAMED = 0.08
"""Shares below are drawn without their number."""
WHOLE = 0.99
"""Shares below add up to less than all outcomes."""


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


def draw_outcomes(axes: Any, report: Report, task: str, traffic: str) -> None:
    """Draw a bar for each algorithm and scripted policy of a cell.

    Args:
        axes: Axes of matplotlib.
        report: Report with the values; those of its main mode are drawn.
        task: Task of the condition.
        traffic: Traffic of the condition.
    """
    names = [name for name, _ in report.names]
    found = [shares(report, name, task, traffic) for name in names]
    left = np.zeros(len(names))
    for outcome in shown_outcomes(report):
        widths = np.array([each[outcome] for each in found])
        bars = axes.barh(names, widths, left=left, color=OUTCOME_COLOURS[outcome], height=0.72)
        texts = [f"{share:.2f}" if share >= LEAST_NAMED else "" for share in widths]
        axes.bar_label(bars, texts, label_type="center", fontsize=7, color="white")
        left += widths
    for row, name in enumerate(names):
        text = missing(report, name, task, traffic)
        axes.text(left[row] + 0.01, row, text, va="center", fontsize=7, color="#777777")
    axes.set_yticks(range(len(names)), [algorithm_label(name) for name in names])
    axes.set_xlim(0.0, 1.0)
    axes.invert_yaxis()
    axes.tick_params(axis="y", length=0)
