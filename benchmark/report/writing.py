"""Writes a report: all of its files, or none."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from benchmark.metrics.results import Frame
from benchmark.report.content import Report, make_report
from benchmark.report.episode_pages import Replays, replays
from benchmark.report.figures import KINDS, PROFILE
from benchmark.report.front import leader
from benchmark.report.html import main_table, pictures, report_page, report_text
from benchmark.report.marl_eval import marl_eval_json
from benchmark.report.robustness import Robustness, robustness_of
from benchmark.report.summary import summaries_of
from benchmark.report.tables import CONDITION_COLUMNS, condition_rows
from benchmark.report.values import as_csv, csv_number
from benchmark.results.files import ResultsError, replaced_folder
from benchmark.results.reading import REPORT, read_results

PAGE, TEXT, VALUES, DIFFERENCES = "report.html", "report.md", "values.csv", "differences.csv"
MARL_EVAL, ROBUSTNESS, CONDITIONS = "marl_eval.json", "robustness.csv", "conditions.csv"


def write_report(root: Path, out: Path | None = None) -> Path:
    """Make an experiment's report from what is on disk; return its page.

    Args:
        root: The experiment's results.
        out: Folder of the report, by default `report` among the results.

    Raises:
        ResultsError: There are no results, or the folder cannot be written to or holds something else.
    """
    results = read_results(root)
    folder = (out or root / REPORT).absolute()
    _check_free(folder)
    report = make_report(results)
    with replaced_folder(folder) as partial:
        played = replays(results, report.modes[0], leader(report))
        for name, content in report_files(report, played).items():
            (partial / name).write_bytes(content)
    return folder / PAGE


def report_files(report: Report, played: Replays | None = None) -> dict[str, bytes]:
    """Return name and content of the files of a report.

    Args:
        report: What it says.
        played: Test episodes that the page plays.
    """
    summaries, robustness = summaries_of(report), robustness_of(report)
    drawn = pictures(report, summaries)
    texts = {
        PAGE: report_page(report, summaries, robustness, played or Replays()),
        TEXT: report_text(report, summaries, drawn, robustness),
        MARL_EVAL: marl_eval_json(report.results, report.modes[0]),
        VALUES: values_csv(report.values),
        DIFFERENCES: differences_csv(report),
        **conditions_csv(report),
        **robustness_csv(robustness),
        **{f"main_table_{mode}.tex": main_table(report, mode) for mode in report.modes},
        **{f"{name}.svg": picture for name, picture in drawn.items()},
    }
    return {name: text.encode() for name, text in texts.items()}


def values_csv(values: Frame) -> str:
    """Return a row for each algorithm, condition, mode and metric; n/a is empty, and its note says why."""
    terms = [
        "; ".join(f"{name}={csv_number(value)}" for name, value in each.items()) for each in values["terms"]
    ]
    return as_csv(values.assign(terms=terms))


def conditions_csv(report: Report) -> dict[str, str]:
    """Return the table "By condition"; no file without one."""
    if not (rows := condition_rows(report)):
        return {}
    return {CONDITIONS: as_csv(pd.DataFrame(rows, columns=[*CONDITION_COLUMNS]))}


def robustness_csv(robustness: Robustness) -> dict[str, str]:
    """Return a row for each task, policy, partner or condition, and rate; no file if nothing was played."""
    if not len(robustness.values):
        return {}
    return {ROBUSTNESS: as_csv(robustness.values)}


def differences_csv(report: Report) -> str:
    """Return a row for each mode, condition, rate and pair; without a better one, "tie" or "not compared"."""
    parts = []
    for mode, found in report.differences.items():
        better = found["wins"].where(found["wins"] != "", "tie")
        better = better.where(found["corrected"].notna(), "not compared")
        named = found.drop(columns="wins").assign(better=better).rename(columns={"pairs": "starts"})
        named.insert(0, "mode", mode)
        parts.append(named)
    return as_csv(pd.concat(parts, ignore_index=True))


def _check_free(folder: Path) -> None:
    """Raise if the folder cannot be replaced by a report.

    Raises:
        ResultsError: It is a file, or holds other files than a report's.
    """
    if folder.is_file():
        raise ResultsError("is a file, not a folder", place=str(folder), remedy="choose another --out")
    if folder.is_dir() and any(folder.iterdir()):
        drawn = (f"{kind.name}.*" for kind in (*KINDS, PROFILE))
        known = [
            PAGE,
            TEXT,
            VALUES,
            DIFFERENCES,
            MARL_EVAL,
            CONDITIONS,
            ROBUSTNESS,
            "main_table_*.tex",
            *drawn,
        ]
        if not ((folder / TEXT).is_file() or (folder / PAGE).is_file()):  # these names are of others
            known = []
        others = {*folder.iterdir()}.difference(*map(folder.glob, known))
        if others:
            raise ResultsError(
                f"holds '{min(others).name}', which is not of a report and would be lost",
                place=str(folder),
                remedy="move it away, then give `smarts-bench report RESULTS`, or with another --out",
            )
