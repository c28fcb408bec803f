"""progress.csv of a run: a line for each training iteration."""

from __future__ import annotations

import csv
import math
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
COUNTS = COLUMNS[:3]
"""Columns that are finite numbers in every line."""
REMEDY = "remove it: the run resumes from its checkpoint, and its curve begins there"


def read_progress(file: Path) -> tuple[Frame, str]:
    """Return the valid lines, none if there is no file, and what is wrong with the others, "" if nothing is.

    A truncated last line is left out and not reported.

    Raises:
        ResultsError: It cannot be read, or is no table of progress.
    """
    if not file.exists():
        return pd.DataFrame(columns=[*COLUMNS]), ""
    try:
        with file.open(newline="", encoding="utf-8") as opened:
            titles, *lines = csv.reader(opened)
        places = [titles.index(name) for name in COLUMNS]
    except (OSError, ValueError, csv.Error) as error:
        raise ResultsError(f"damaged: {first_line(error)}", place=str(file), remedy=REMEDY) from error
    if lines and len(lines[-1]) < len(titles):
        del lines[-1]
    valid, problems = [], []
    for number, line in enumerate(lines, start=2):
        try:
            if len(line) != len(titles):
                raise ValueError(f"{len(line)} values instead of {len(titles)}")
            valid.append([_number(name, line[place]) for name, place in zip(COLUMNS, places, strict=True)])
        except ValueError as error:
            problems.append(f"line {number}, {error}")
    table: Frame = pd.DataFrame(valid, columns=[*COLUMNS]).astype({"iteration": int, "agent_steps": int})
    return table, "; ".join(problems)


def _number(name: str, text: str) -> float:
    """Return a value of a column, NaN for an empty one.

    Raises:
        ValueError: It is no number, or not finite in a column of `COUNTS`.
    """
    try:
        number = float(text or "nan")
    except ValueError:
        number = None
    if number is None or (name in COUNTS and not math.isfinite(number)):
        raise ValueError(f"{name} is {text!r}")
    return number


def begin_progress(file: Path, iteration: int) -> list[dict[Hashable, Any]]:
    """Keep and return the lines up to an iteration; training repeats the later ones.

    Raises:
        ResultsError: It is damaged, or cannot be written.
    """
    lines, problem = read_progress(file)
    if problem:
        raise ResultsError(f"damaged: {problem}", place=str(file), remedy=REMEDY)
    kept = lines[lines["iteration"] <= iteration]
    text = file.read_text(encoding="utf-8").splitlines() if file.exists() else [",".join(COLUMNS)]
    # As they were written: numbers that pandas writes look different.
    whole = [text[0], *(text[number + 1] for number in kept.index)]
    write_whole(file, lambda partial: partial.write_text("\n".join(whole) + "\n", encoding="utf-8"))
    return kept.to_dict("records")


def add_progress(file: Path, line: Mapping[str, Any]) -> None:
    """Append a line."""
    with named_failures(file), file.open("a", newline="", encoding="utf-8") as opened:
        csv.DictWriter(opened, COLUMNS, lineterminator="\n").writerow(line)
