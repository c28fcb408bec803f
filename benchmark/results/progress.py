"""progress.csv of a run: a line for each training iteration."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

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
COUNTS = COLUMNS[:3]
"""Columns that are finite numbers in every line."""
REMEDY = "remove it: the run resumes from its checkpoint, and its curve begins there"

Line = Mapping[str, Any]


def read_progress(file: Path) -> tuple[list[dict[str, str]], dict[int, str]]:
    """Return the valid lines, and line number -> problem of others; lines that a kill cut short are dropped.

    Raises:
        ResultsError: It cannot be read, or is no table of progress.
    """
    if not file.exists():
        return [], {}
    try:
        with file.open(newline="", encoding="utf-8") as opened:
            reader = csv.DictReader(opened)
            lines = [line for line in reader if None not in line and None not in line.values()]
            titles = set(reader.fieldnames or ())
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ResultsError(f"cannot be read: {first_line(error)}", place=str(file), remedy=REMEDY) from error
    if set(COLUMNS) - titles:
        raise ResultsError("not a table of progress", place=str(file), remedy=REMEDY)
    valid, problems = [], {}
    for number, line in enumerate(lines, start=2):
        if problem := _problem(line):
            problems[number] = problem
        else:
            valid.append(line)
    return valid, problems


def begin_progress(file: Path, iteration: int) -> list[dict[str, str]]:
    """Keep and return the lines up to an iteration; training repeats the later ones.

    Raises:
        ResultsError: It is damaged, or cannot be written.
    """
    lines, problems = read_progress(file)
    if problems:
        problem = next(iter(problems.values()))
        raise ResultsError(f"damaged: {problem}", place=str(file), remedy=REMEDY)
    kept = [line for line in lines if int(float(line["iteration"])) <= iteration]
    write_whole(file, lambda partial: _write(partial, kept))
    return kept


def add_progress(file: Path, line: Line) -> None:
    """Append a line."""
    with named_failures(file), file.open("a", newline="", encoding="utf-8") as opened:
        csv.DictWriter(opened, COLUMNS).writerow(line)


def _write(file: Path, lines: Sequence[Line]) -> None:
    with file.open("w", newline="", encoding="utf-8") as out:
        writer = csv.DictWriter(out, COLUMNS)
        writer.writeheader()
        writer.writerows(lines)


def _problem(line: Mapping[str, str]) -> str:
    """Return the first value that is no number, or is empty or infinite in `COUNTS`; "" for a valid line."""
    for name in COLUMNS:
        try:
            is_finite = math.isfinite(float(line[name] or "nan"))
        except ValueError:
            return f"{name} is {line[name]!r}"
        if name in COUNTS and not is_finite:
            return f"{name} is {line[name]!r}"
    return ""
