"""The page: one file that needs nothing else, no network either."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import groupby
from typing import Any

from benchmark.metrics import METRICS
from benchmark.report import figures, overview, paper, provenance, summary, tables, wording
from benchmark.report.content import Report
from benchmark.report.episode_pages import EpisodeLinks
from benchmark.report.robustness import Robustness
from benchmark.report.style import data_uri
from benchmark.report.summary import Summaries
from benchmark.report.values import MODES

MODULES = (figures, overview, paper, provenance, summary, tables, wording)
"""Modules of this package whose texts and tables the page's template calls by their names."""
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
    own = {name: Markup("".join(map(_source, files))) for name, files in _OWN.items()}
    return _templates().get_template(template).render(**own, **content) + "\n"


def _source(file: str) -> str:
    return _templates().loader.get_source(_templates(), file)[0]


def report_page(
    report: Report,
    summaries: Summaries,
    profile: bytes | None,
    links: Sequence[EpisodeLinks],
    robustness: Robustness,
) -> str:
    """Return a report as an HTML page.

    Args:
        report: What it says.
        summaries: Over its cells.
        profile: Picture of the performance profile, a PNG file; None without summaries.
        links: Links to recorded test episodes.
        robustness: What was played beside the tests.
    """
    by_traffic = groupby(report.columns, key=lambda column: column[1])
    return fill(
        "report.html.j2",
        **{module.__name__.rpartition(".")[2]: module for module in MODULES},
        report=report,
        results=report.results,
        summaries=summaries,
        profile=profile and data_uri(profile),
        links=links,
        robustness=robustness,
        groups=[(paper.traffic_label(traffic), len([*group])) for traffic, group in by_traffic],
        overview_rows=overview.overview_rows(report),
        has_counterparts=wording.has_counterparts(report),
        metrics=[METRICS[name] for name in report.metrics],
        tasks=[(name, paper.task_label(name)) for name in report.tasks],
        traffics=[(name, paper.traffic_label(name)) for name in report.traffics],
        modes=[(mode, mode) for mode in MODES if mode in report.modes],
    )
