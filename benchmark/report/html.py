"""The page, one file that needs nothing else, no network either; the same as Markdown and LaTeX; pictures."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterable
from functools import cache
from itertools import groupby
from typing import Any

from benchmark.metrics import METRICS
from benchmark.metrics.registry import PAPER_METRICS
from benchmark.report import (
    contrasts,
    drawing,
    figures,
    front,
    paper,
    provenance,
    summary,
    tables,
    wording,
)
from benchmark.report.content import Report
from benchmark.report.episode_pages import Replays
from benchmark.report.robustness import Robustness
from benchmark.report.style import OUTCOME_COLOURS, PALETTE, thousands
from benchmark.report.summary import Summaries
from benchmark.report.values import MODES

MODULES = (contrasts, drawing, figures, front, paper, provenance, summary, tables, wording)
"""Modules of this package whose texts and tables the templates call by their names."""
SHOWN_FIRST = ("completion", "collision")
"""Learning curves above the fold."""
HTML = re.compile(r"<(?!br>)(?=[A-Za-z/!?])|&(?=#?\w+;)")
"""Begins a tag or an entity; `<br>` is the only tag in Markdown."""
OF_LATEX = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    **{sign: f"\\{sign}" for sign in "&%$#_{}"},
}


@cache
def _templates() -> Any:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader("benchmark.report")
    made = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    made.filters |= {"latex": latex, "without_html": without_html, "in_table": in_table}
    return made


@cache
def _texts() -> Any:
    return _templates().overlay(autoescape=False)


@cache
def _latex_texts() -> Any:
    names = ("block_start", "block_end", "variable_start", "variable_end", "comment_start", "comment_end")
    signs = zip(names, ("<%", "%>", "<<", ">>", "<#", "#>"), strict=True)
    return _texts().overlay(**{f"{name}_string": sign for name, sign in signs})


def latex(text: str) -> str:
    """Return a text as LaTeX prints it."""
    return "".join(OF_LATEX.get(sign, sign) for sign in text)


def without_html(text: str) -> str:
    """Return Markdown without HTML, which names and descriptions may hold."""
    return HTML.sub(lambda found: {"<": "&lt;", "&": "&amp;"}[found[0]], text)


def in_table(text: str) -> str:
    """Return a text as a table in Markdown has it."""
    return text.replace("|", "\\|").replace("\n", " ")


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
    robustness: Robustness,
    replays: Replays,
) -> str:
    """Return a report as an HTML page.

    Args:
        report: What it says.
        summaries: Over its conditions.
        robustness: What was played beside the tests.
        replays: Test episodes that the page plays.
    """
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
        robustness=robustness,
        groups=_groups(report),
        tasks=[(name, paper.task_label(name)) for name in report.tasks],
        traffics=[(name, paper.traffic_label(name)) for name in report.traffics],
        metrics=[METRICS[name] for name in report.metrics],
        modes=[(mode, mode) for mode in MODES if mode in report.modes],
    )


def _groups(report: Report) -> list[tuple[str, int]]:
    """Return label and number of conditions of each traffic, as columns are grouped."""
    by_traffic = groupby(report.columns, key=lambda column: column[1])
    return [(paper.traffic_label(traffic), len([*group])) for traffic, group in by_traffic]


def report_text(
    report: Report,
    summaries: Summaries,
    pictures: Iterable[str],
    robustness: Robustness,
) -> str:
    """Return a report as Markdown; see `report_page`.

    Args:
        report: What it says.
        summaries: Over its conditions.
        pictures: Names of the kinds of plots that lie beside it.
        robustness: What was played beside the tests.
    """
    given = {"summaries": summaries, "pictures": {*pictures}, "robustness": robustness}
    metrics = [METRICS[name] for name in report.metrics]
    template = _texts().get_template("report.md.j2")
    return template.render(**_modules(), **given, report=report, results=report.results, metrics=metrics)


def main_table(report: Report, mode: str) -> str:
    """Return the main table in LaTeX, with intervals and the figures of the paper."""
    template = _latex_texts().get_template("main_table.tex.j2")
    return template.render(**_modules(), report=report, mode=mode, groups=_groups(report)) + "\n"
