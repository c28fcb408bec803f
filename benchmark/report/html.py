"""The page: one file that needs nothing else, no network either."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from functools import cache
from itertools import groupby
from typing import Any

from benchmark.metrics import METRICS
from benchmark.metrics.registry import PAPER_METRICS
from benchmark.report import (
    drawing,
    figures,
    front,
    overview,
    paper,
    provenance,
    summary,
    tables,
    wording,
)
from benchmark.report.content import Report
from benchmark.report.episode_pages import EpisodeLinks, Replays
from benchmark.report.robustness import Robustness
from benchmark.report.style import OUTCOME_COLOURS, PALETTE, thousands
from benchmark.report.summary import Summaries
from benchmark.report.values import MODES

MODULES = (drawing, figures, front, overview, paper, provenance, summary, tables, wording)
"""Modules of this package whose texts and tables the templates call by their names."""
SHOWN_FIRST = ("completion", "collision")
"""Learning curves above the fold."""


@cache
def _templates() -> Any:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader("benchmark.report")
    return Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True)


def fill(template: str, **content: Any) -> str:
    """Return a page or a picture, with this package's style and script in it."""
    from markupsafe import Markup

    def source(*files: str) -> Markup:  # the one place where text goes into a page unescaped: of this package
        return Markup("".join(_templates().loader.get_source(_templates(), file)[0] for file in files))

    lines = {f"c{number}": shade for number, shade in enumerate(PALETTE)}
    colours = "; ".join(f"--{name}: {shade}" for name, shade in (lines | OUTCOME_COLOURS).items())
    own = {"colours": Markup(colours), "style": source("plots.css", "page.css")}
    own |= {"plot_style": source("plots.css"), "script": source("rows.js", "page.js")}
    return _templates().get_template(template).render(**own, **content) + "\n"


def _modules() -> dict[str, Any]:
    return {module.__name__.rpartition(".")[2]: module for module in MODULES}


def pictures(report: Report, summaries: Summaries) -> dict[str, str]:
    """Return name of a kind of plot -> its picture of all conditions, an SVG file."""
    wanted = [(kind, report.columns) for kind in figures.KINDS if report.columns]
    wanted += [(figures.PROFILE, [()])] if summaries.algorithms else []
    return {
        kind.name: fill(
            "figure.svg.j2",
            **_modules(),
            kind=kind,
            places=places,
            report=report,
            summaries=summaries,
            metrics=PAPER_METRICS if kind.name == "radar_all" else drawing.axes_of_radar(),
            titles=drawing.TITLES,
        )
        for kind, places in wanted
    }


def report_page(
    report: Report,
    summaries: Summaries,
    links: Sequence[EpisodeLinks],
    robustness: Robustness,
    replays: Replays,
) -> str:
    """Return a report as an HTML page.

    Args:
        report: What it says.
        summaries: Over its conditions.
        links: Links to recorded test episodes.
        robustness: What was played beside the tests.
        replays: Test episodes that the page plays.
    """
    by_traffic = groupby(report.columns, key=lambda column: column[1])
    names = front.best_first(report)
    learning = {x: [drawing.curves(report, *x, rate) for rate in SHOWN_FIRST] for x in report.columns}
    return fill(
        "report.html.j2",
        **_modules(),
        report=report,
        results=report.results,
        names=names,
        best=front.leader(report),
        finished=[
            place for place in report.columns if any(place in front.places_of(report, x) for x in names)
        ],
        learning=[(place, panels) for place, panels in learning.items() if all(panels)],
        rows_of=lambda mode: sorted(report.main_table(mode), key=lambda row: names.index(row.algorithm)),
        paper_metrics=PAPER_METRICS,
        thousands=thousands,
        summaries=summaries,
        replays=replays,
        viewer=base64.b64encode(replays.page).decode(),
        links=links,
        robustness=robustness,
        groups=[(paper.traffic_label(traffic), len([*group])) for traffic, group in by_traffic],
        tasks=[(name, paper.task_label(name)) for name in report.tasks],
        traffics=[(name, paper.traffic_label(name)) for name in report.traffics],
        metrics=[METRICS[name] for name in report.metrics],
        modes=[(mode, mode) for mode in MODES if mode in report.modes],
    )
