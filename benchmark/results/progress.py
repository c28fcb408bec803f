"""progress.csv of a run: a line for each training iteration."""

from __future__ import annotations

import csv
from collections.abc import Hashable, Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from benchmark.metrics.results import Frame
from benchmark.results.files import ResultsError, first_line, named_failures, write_whole

COLUMNS: tuple[str, ...] = (
    "iteration",
    "agent_steps",
    "seconds",
    "agent_steps_per_second",
    "return",
    "completion",
    "collision",
    "validation_return",
    "validation_completion",
    "validation_collision",
)
"""Means over the last episodes of training, and of the validation if there was one; these may be empty."""
REMEDY = "remove it: the run resumes from its checkpoint, and its curve begins there"


def read_progress(file: Path) -> Frame:
    """Return the lines, none if there is no file; a last line that a kill has cut short is left out.

    Raises:
        ResultsError: It cannot be read, or is no table of progress.
    """
    try:
        lines = csv.DictReader(_whole_lines(file))
        rows = [[float(line[name] or "nan") for name in COLUMNS] for line in lines]
        return pd.DataFrame(rows, columns=[*COLUMNS]).astype({"iteration": int, "agent_steps": int})
    except (KeyError, ValueError) as error:
        raise ResultsError(f"damaged: {first_line(error)}", place=str(file), remedy=REMEDY) from error


def _whole_lines(file: Path) -> list[str]:
    """Return the lines of a file, without a last one that has no end; none if there is no file."""
    if not file.exists():
        return []
    lines = file.read_text(encoding="utf-8").splitlines(keepends=True)
    return lines if lines and lines[-1].endswith("\n") else lines[:-1]


def begin_progress(file: Path, iteration: int) -> list[dict[Hashable, Any]]:
    """Keep and return the lines up to an iteration; training repeats the later ones.

    Raises:
        ResultsError: It is damaged, or cannot be written.
    """
    table = read_progress(file)
    is_kept = table["iteration"] <= iteration
    title, *lines = _whole_lines(file) or [",".join(COLUMNS) + "\n"]
    # As they were written: numbers that pandas writes look different.
    text = "".join([title, *(line for line, kept in zip(lines, is_kept, strict=True) if kept)])
    write_whole(file, lambda partial: partial.write_text(text, encoding="utf-8"))
    return table[is_kept].to_dict("records")


def add_progress(file: Path, line: Mapping[str, Any]) -> None:
    """Append a line."""
    with named_failures(file), file.open("a", newline="", encoding="utf-8") as opened:
        csv.DictWriter(opened, COLUMNS, lineterminator="\n").writerow(line)
