"""The page: one file that needs nothing else, no network either."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import groupby
from typing import Any

from benchmark.metrics import METRICS
from benchmark.report import overview, provenance, tables, wording
from benchmark.report.content import Report, Row, TableCell
from benchmark.report.episode_pages import EpisodeLinks
from benchmark.report.figures import KINDS, draw_cells, legend, note_of
from benchmark.report.paper import algorithm_label, task_differences, task_label, traffic_label
from benchmark.report.robustness import Robustness
from benchmark.report.style import data_uri
from benchmark.report.summary import COLUMNS, IMPROVEMENT_COLUMNS, PROFILE_NOTE, Summaries


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


_OWN = {"style": ("page.css",), "script": ("rows.js", "page.js")}


def _source(file: str) -> str:
    return _templates().loader.get_source(_templates(), file)[0]


def report_page(
    report: Report,
    summaries: Summaries,
    profile: bytes | None,
    links: Sequence[EpisodeLinks] = (),
    robustness: Robustness | None = None,
) -> str:
    """Return a report as an HTML page.

    Args:
        report: What it says.
        summaries: Over its cells.
        profile: Picture of the performance profile, a PNG file; None without summaries.
        links: To recorded test episodes.
        robustness: What was played beside the tests.
    """
    results = report.results
    rows, notes = tables.metrics_table(report)
    return fill(
        "report.html.j2",
        name=results.name,
        description=results.description,
        totals=provenance.totals(results),
        standing=wording.standing(report),
        gaps=provenance.gaps(results),
        tables=[_main_table(report, mode) for mode in report.modes],
        main_mode=report.modes[0],
        metrics={
            "rows": rows,
            "notes": notes,
            "columns": [_column(name) for name in report.metrics],
            "tasks": [(name, task_label(name)) for name in report.tasks],
            "traffics": [(name, traffic_label(name)) for name in report.traffics],
            "modes": tables.mode_choices(report),
            "chosen": report.modes[0],
        },
        plots=[
            {
                "name": kind.name,
                "title": kind.title,
                "note": note_of(kind, report),
                "legend": legend(kind, report),
                "cells": draw_cells(kind, report),
            }
            for kind in KINDS
        ],
        overview=(overview.COLUMNS.items(), overview.overview_rows(report), overview.LEFT),
        overview_note=overview.note(report),
        summary=_summary(summaries, profile),
        episodes=links,
        robustness=robustness if robustness is not None and robustness.is_there else None,
        generalization=tables.generalization_rows(report),
        generalization_columns=tables.GENERALIZATION_COLUMNS.items(),
        differences=tables.difference_rows(report),
        difference_notes=tables.difference_notes(report),
        best=wording.BEST,
        intervals=wording.INTERVALS,
        compared=wording.COMPARED,
        against_paper=wording.AGAINST_PAPER if report.has_paper else "",
        task_differences=(wording.TASK_DIFFERENCES.items(), task_differences(), range(3)),
        task_differences_title=wording.TASK_DIFFERENCES_TITLE if wording.has_counterparts(report) else "",
        difference_columns=tables.DIFFERENCE_COLUMNS.items(),
        commands=provenance.commands(results),
        circumstances=provenance.circumstances(results),
        runs=provenance.run_rows(results),
        run_columns=provenance.RUN_COLUMNS.items(),
    )


def _summary(summaries: Summaries, profile: bytes | None) -> dict[str, Any] | None:
    if profile is None:
        return None
    return {
        "note": summaries.note,
        "tables": [
            (COLUMNS.items(), summaries.mean_rows(), (0,)),
            (IMPROVEMENT_COLUMNS.items(), summaries.improvement_rows(), (0, 1)),
        ],
        "profile": data_uri(profile),
        "profile_note": PROFILE_NOTE,
    }


def _column(name: str) -> dict[str, Any]:
    measure = METRICS[name]
    unit = f" [{measure.unit}]" if measure.unit else ""
    parts = ("label", "meaning", "unit", "better", "missing")
    return {"name": name, "title": measure.label + unit} | {part: getattr(measure, part) for part in parts}


def _main_table(report: Report, mode: str) -> dict[str, Any]:
    columns = report.columns
    below = wording.BELOW_CELLS_WITH_PAPER if report.has_paper else wording.BELOW_CELLS
    return {
        "mode": mode,
        "title": f"{wording.MODE_TITLES[mode]} episodes",
        "note": f"{wording.MODE_NOTES[mode]} {wording.BOLD} {below}",
        "groups": [
            (traffic_label(traffic), len([*group]))
            for traffic, group in groupby(columns, key=lambda it: it[1])
        ],
        "columns": [task_label(task) for task, _ in columns],
        "rows": [_row(row) for row in report.main_table(mode)],
    }


def _row(row: Row) -> dict[str, Any]:
    return {
        "label": algorithm_label(row.algorithm),
        "is_scripted": row.is_scripted,
        "cells": [_cell(cell) for cell in row.cells],
    }


def _cell(cell: TableCell) -> dict[str, Any]:
    known = cell.completion is not None and cell.completion.is_known
    return {
        "figures": wording.figures(cell),
        "sort": f"{cell.completion.value:.6g}" if cell.completion is not None and known else "",
        "is_best": cell.is_best,
        "rank": wording.rank_text(cell),
        "intervals": wording.intervals(cell),
        "interval_meaning": wording.interval_meaning(cell),
        "paper": wording.printed_text(cell.printed),
        "mark": wording.mark(cell),
        "not_counted": wording.not_counted(cell),
        "mark_meaning": wording.mark_meaning(cell),
        "count": wording.count(cell),
    }
