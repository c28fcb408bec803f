"""The plots beside report.md: one file a kind, of all conditions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from benchmark.metrics.registry import PAPER_METRICS
from benchmark.report import curves, outcomes, radar
from benchmark.report.content import Report
from benchmark.report.paper import algorithm_label, task_label, traffic_label
from benchmark.report.style import OUTCOME_COLOURS, TEXT, line, new_figure, png
from benchmark.report.wording import MODE_NOTES

LEGEND_WIDTH = 1.45
"""Width of an entry with the longest name [inches]."""
SHORT_TRAFFIC = {"no_social_vehicles": "No SV", "random_social_vehicles": "SV"}


@dataclass(frozen=True)
class Kind:
    """A kind of plot."""

    name: str
    """Name of the plot's file."""
    title: str
    note: str
    """What one has to know to read it; {}: which episodes are shown."""
    size: tuple[float, float]
    """Size of a condition's plot [inches]."""
    panels: int
    """Axes of a cell, one below the other."""
    projection: str | None
    draw: Callable[[Any, Report, str, str], None]
    """Draws a cell into its axes, or into the list of them."""


BEHAVIOUR = (
    "{} All scales go from 0 to 1 in every plot; a gap is a metric with nothing to measure. Diversity "
    "describes, more of it is not better."
)
ALL_INDICES = (
    "As above, with all of the paper's metrics; of rates that are better when lower, 1 minus the value. "
    "Diversity, stochasticity and cut-ins describe or have few cases: look at the counts in the table."
)
LEARNING = (
    "Line: mean over training seeds of the last training episodes, which explore, as far as all seeds are "
    "there; thin lines: each seed. Band: from the lowest seed to the highest. Dots: greedy validation "
    "episodes of each seed."
)
OUTCOMES = "{} Each agent-episode has one outcome; shares add up to 1."
_four = partial(radar.draw_radar, names=radar.axes_of_radar())
_all = partial(radar.draw_radar, names=PAPER_METRICS)
KINDS = (
    Kind("radar", "Behaviour", BEHAVIOUR, (3.1, 2.75), 1, "polar", _four),
    Kind("radar_all", "All indices", ALL_INDICES, (3.9, 3.2), 1, "polar", _all),
    Kind("learning_curves", "Learning curves", LEARNING, (3.6, 5.0), 3, None, curves.draw_curves),
    Kind("outcomes", "Outcomes", OUTCOMES, (3.6, 2.4), 1, None, outcomes.draw_outcomes),
)


def note_of(kind: Kind, report: Report) -> str:
    """Return what one has to know to read a kind of plot."""
    return kind.note.format(MODE_NOTES[report.modes[0]])


def cell_title(task: str, traffic: str) -> str:
    """Return the name of a cell as the paper's plots have it."""
    return f"{task_label(task)}: {SHORT_TRAFFIC.get(traffic, traffic_label(traffic))}"


def _size(kind: Kind, report: Report) -> tuple[float, float]:
    """Return width and height of a cell's plot [inch]; bars need some for each row."""
    width, height = kind.size
    return width, 0.7 + 0.27 * len(report.names) if kind.name == "outcomes" else height


def draw_all(kind: Kind, report: Report) -> bytes:
    """Return one picture of all cells with its legend, a PNG file."""
    import matplotlib as mpl

    columns = report.columns
    across = len(columns) if kind.panels > 1 else max(1, len(report.tasks))
    down = -(-len(columns) // across)
    width, height = _size(kind, report)
    with mpl.rc_context(TEXT):
        figure = new_figure(width * across * (0.8 if kind.panels > 1 else 1.0), height * down + 0.5)
        for panels, (task, traffic) in zip(_panels(figure, kind, columns, across), columns, strict=True):
            panels[0].set_title(cell_title(task, traffic))
            kind.draw(_one_or_all(panels), report, task, traffic)
        handles = _handles(kind, report)
        if handles:
            ncols = min(len(handles), max(1, int(figure.get_figwidth() / LEGEND_WIDTH)))
            figure.legend(handles=handles, loc="outside lower center", ncols=ncols, frameon=False)
        return png(figure)


def _handles(kind: Kind, report: Report) -> list[Any]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    if kind.name == "outcomes":
        shown = outcomes.shown_outcomes(report)
        return [Patch(color=OUTCOME_COLOURS[name], label=outcomes.outcome_label(name)) for name in shown]
    names = report.algorithms
    return [Line2D([], [], label=algorithm_label(name), **line(name, names)) for name in names]


def _panels(figure: Any, kind: Kind, columns: Sequence[tuple[str, str]], across: int = 1) -> list[list[Any]]:
    """Return the axes of each cell."""
    given: Mapping[str, Any] = {"projection": kind.projection} if kind.projection else {}
    if kind.panels == 1:
        down = -(-len(columns) // across)
        return [[figure.add_subplot(down, across, number + 1, **given)] for number in range(len(columns))]
    grid = figure.subplots(kind.panels, len(columns), sharex="col", squeeze=False, subplot_kw=given)
    return [list(grid[:, number]) for number in range(len(columns))]


def _one_or_all(panels: list[Any]) -> Any:
    return panels if len(panels) > 1 else panels[0]
