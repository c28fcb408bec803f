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
    outcomes,
    overview,
    paper,
    provenance,
    radar,
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

MODULES = (drawing, figures, front, outcomes, overview, paper, provenance, radar, summary, tables, wording)
"""Modules of this package whose texts and tables the page's template calls by their names."""
SHOWN_FIRST = ("completion", "collision")
"""Learning curves above the fold."""
_OWN = {"style": ("page.css",), "script": ("rows.js", "page.js")}


@cache
def _templates() -> Any:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader("benchmark.report")
    return Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True)


def fill(template: str, **content: Any) -> str:
    """Return a page, with this package's style and script in it."""
    from markupsafe import Markup

    # The one place where text goes into a page unescaped: files of this package.
    own = {name: "".join(map(_source, files)) for name, files in _OWN.items()}
    given = {"style": Markup(_colours() + own["style"]), "script": Markup(own["script"])}
    return _templates().get_template(template).render(**given, **content) + "\n"


def _source(file: str) -> str:
    return _templates().loader.get_source(_templates(), file)[0]


def _colours() -> str:
    """Return the plots' colours as variables of CSS, lighter ones of lines where the page is dark."""
    lines = {f"--c{number}": shade for number, shade in enumerate(PALETTE)}
    light = lines | {f"--{name}": shade for name, shade in OUTCOME_COLOURS.items()}
    dark = {name: f"color-mix(in oklab, {shade}, white 30%)" for name, shade in lines.items()}
    rules = ["; ".join(f"{name}: {shade}" for name, shade in each.items()) for each in (light, dark)]
    is_dark = "@media screen and (prefers-color-scheme: dark)"
    return f":root {{ {rules[0]} }}\n{is_dark} {{ :root {{ {rules[1]} }} }}\n"


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
        **{module.__name__.rpartition(".")[2]: module for module in MODULES},
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
