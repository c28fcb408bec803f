"""The report as Markdown, its plots as SVG files beside it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

from benchmark.metrics import METRICS
from benchmark.report import overview, provenance, tables, wording
from benchmark.report.content import Report, TableCell
from benchmark.report.episode_pages import EpisodeLinks
from benchmark.report.figures import KINDS, PROFILE, note_of
from benchmark.report.paper import algorithm_label, condition_label, task_differences
from benchmark.report.robustness import TITLE, Entry, Robustness
from benchmark.report.summary import COLUMNS, IMPROVEMENT_COLUMNS, Summaries

HTML = re.compile(r"<(?!br>)(?=[A-Za-z/!?])|&(?=#?\w+;)")
"""Begins a tag or an entity; `<br>` is the only tag of this page."""


def report_text(
    report: Report,
    summaries: Summaries,
    pictures: Iterable[str],
    links: Sequence[EpisodeLinks],
    robustness: Robustness,
) -> str:
    """Return a report as Markdown.

    Args:
        report: What it says.
        summaries: Over its conditions.
        pictures: Names of the kinds of plots that lie beside it.
        links: Links to recorded test episodes.
        robustness: What was played beside the tests.
    """
    results = report.results
    parts = [f"# {results.name}", results.description, " ".join(provenance.totals(results))]
    parts += wording.standing(report)
    gaps = provenance.gaps(results)
    if gaps:
        parts += ["Notes:", "\n".join(f"- {place}: {reason}" for place, reason in gaps)]
    for mode in report.modes:
        parts += [f"## {wording.MODE_TITLES[mode]} episodes: collision rate / completion rate"]
        parts += [f"{wording.MODE_NOTES[mode]} {wording.BOLD}", _main_table(report, mode)]
    parts += [
        wording.AGAINST_PAPER if report.has_paper else "",
        wording.INTERVALS,
        wording.COMPARED,
        " ".join(tables.difference_notes(report)),
    ]
    lines = overview.overview_rows(report)
    if lines:
        parts += ["## Overview", overview.note(report), table([*overview.COLUMNS], lines, left=3)]
    if summaries.algorithms:
        parts += ["## Summary over conditions", summaries.note, table([*COLUMNS], summaries.mean_rows())]
        parts += [table([*IMPROVEMENT_COLUMNS], summaries.improvement_rows(), left=2)]
        parts += [f"![{PROFILE.title}]({PROFILE.name}.svg)", PROFILE.note]
    there = set(pictures)
    for kind in KINDS:
        if kind.name in there:
            parts += [f"## {kind.title}", f"![{kind.title}]({kind.name}.svg)", note_of(kind, report)]
    parts += [
        _by_condition(report),
        "## All metrics",
        *_metrics(report),
        "## Generalization",
        _generalization(report),
    ]
    if robustness.is_there:
        parts += [f"## {TITLE}", *_robustness(robustness)]
    if links:
        parts += [
            "## Test episodes",
            table(["Algorithm", "Task", "Traffic", "Seed", "Episodes"], _episodes(links), 5),
        ]
    if wording.has_counterparts(report):
        parts += [f"## {wording.TASK_DIFFERENCES_TITLE}"]
        parts += [table([*wording.TASK_DIFFERENCES], task_differences(), left=3)]
    parts += ["## Definitions", _definitions(report)]
    commands = "\n".join(provenance.commands(results)).replace("\n", "\n    ")
    parts += ["## Runs and machine", code := f"    {commands}"]
    parts += ["\n".join(f"- {name}: {'; '.join(each)}" for name, each in provenance.circumstances(results))]
    parts += [table([*provenance.RUN_COLUMNS], provenance.run_rows(results), left=5)]
    return "\n\n".join(part if part is code else _inert(part) for part in parts if part) + "\n"


def _inert(text: str) -> str:
    """Return a text without HTML, which names and descriptions may hold."""
    return HTML.sub(lambda found: {"<": "&lt;", "&": "&amp;"}[found[0]], text)


def table(titles: Sequence[str], rows: Iterable[Sequence[str]], left: int = 1) -> str:
    """Return a table, its first `left` columns to the left and the others to the right."""
    rule = [":--" if number < left else "--:" for number in range(len(titles))]
    lines = [titles, rule, *([_escaped(cell) for cell in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _escaped(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


def _main_table(report: Report, mode: str) -> str:
    columns = report.columns
    titles = ["Algorithm", *(condition_label(task, traffic) for task, traffic in columns)]
    rows = []
    for row in report.main_table(mode):
        name = algorithm_label(row.algorithm) + (" (scripted)" if row.is_scripted else "")
        rows.append([name, *map(_cell, row.cells)])
    return table(titles, rows)


def _cell(cell: TableCell) -> str:
    paper = wording.printed_text(cell.printed)
    word = ": ".join(filter(None, (f"paper {paper}", wording.mark(cell))))
    beside = "<br>".join(filter(None, (word, wording.not_counted(cell)))) if paper else ""
    if not wording.figures(cell):
        return "<br>".join(filter(None, (wording.NO_RUN, beside)))
    first = f"**{wording.figures(cell)}**" if cell.is_best else wording.figures(cell)
    rank = wording.rank_text(cell)
    return "<br>".join(filter(None, (first, rank, wording.intervals(cell), beside, wording.count(cell))))


def _metrics(report: Report) -> list[str]:
    """Return a table for each condition: a row for each metric, since pages are narrow."""
    rows, notes = tables.metrics_table(report)
    parts = []
    for task, traffic in report.columns:
        mode = report.modes[0]
        own = [row for row in rows if (row.task, row.traffic, row.mode) == (task, traffic, mode)]
        if not own:
            continue
        lines = []
        for number, metric in enumerate(report.metrics):
            cells = [row.cells[number] for row in own]
            lines.append([tables.metric_title(metric), *map(_entry, cells)])
        parts.append(f"### {condition_label(task, traffic)}")
        parts.append(table(["Metric", *(row.label for row in own)], lines))
    parts.append("\n".join(f"{number}. {note}" for number, note in enumerate(notes, start=1)))
    return parts


def _by_condition(report: Report) -> str:
    rows = tables.condition_rows(report)
    return f"## By condition\n\n{table([*tables.CONDITION_COLUMNS], rows, left=5)}" if rows else ""


def _entry(entry: tables.MetricCell | None) -> str:
    if entry is None:
        return ""
    notes = f" ({', '.join(map(str, entry.notes))})" if entry.notes else ""
    return "<br>".join(filter(None, (f"{entry.text}{notes}", entry.interval, entry.count)))


def _generalization(report: Report) -> str:
    rows = tables.generalization_rows(report)
    return (
        table([*tables.GENERALIZATION_COLUMNS], rows, left=3)
        if rows
        else "No held-out variations were played."
    )


def _robustness(robustness: Robustness) -> Iterator[str]:
    yield from robustness.notes
    if robustness.left_out:
        yield "Left out:\n\n" + "\n".join(f"- {line}" for line in robustness.left_out)
    for matrix in robustness.matrices:
        yield f"### {matrix.title}"
        rows = [[label, *map(_shift, entries)] for label, entries in matrix.rows]
        yield table(["Policy", *matrix.columns], rows)


def _shift(entry: Entry | None) -> str:
    return "" if entry is None else "<br>".join(filter(None, (entry.figures, entry.intervals, entry.change)))


def _episodes(links: Sequence[EpisodeLinks]) -> Iterator[list[str]]:
    for each in links:
        shown = [f"[{text}]({place})" for text, place in each.links]
        yield [*each.names, "<br>".join(filter(None, (*shown, each.problem)))]


def _definitions(report: Report) -> str:
    lines = []
    for name in report.metrics:
        measure = METRICS[name]
        better = f"; {measure.better} is better" if measure.better else "; describes"
        lines.append(f"- **{measure.label}**: {measure.meaning}{better}; n/a: {measure.missing}")
    return "\n".join(lines)
