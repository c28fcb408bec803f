"""progress.csv of a run: a line for each training iteration."""

from __future__ import annotations

import csv
import io
from collections.abc import Hashable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
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


def read_progress(file: Path) -> Frame:
    """Return the lines, without a truncated last one; none if there is no file.

    Raises:
        ResultsError: It cannot be read, or is no table of progress.
    """
    if not file.exists():
        return pd.DataFrame(columns=[*COLUMNS])
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
        if lines and lines[-1].count(",") < lines[0].count(","):
            del lines[-1]
        table: Frame = pd.read_csv(io.StringIO("\n".join(lines)), index_col=False)[[*COLUMNS]]
        for name in COLUMNS:
            values = table[name].to_numpy(float)
            if name in COUNTS and not np.isfinite(values).all():
                raise ValueError(f"{name} is not finite in each line")
    except (OSError, ValueError, KeyError) as error:
        raise ResultsError(f"damaged: {first_line(error)}", place=str(file), remedy=REMEDY) from error
    return table


def begin_progress(file: Path, iteration: int) -> list[dict[Hashable, Any]]:
    """Keep and return the lines up to an iteration; training repeats the later ones.

    Raises:
        ResultsError: It is damaged, or cannot be written.
    """
    lines = read_progress(file)
    kept = lines[lines["iteration"] <= iteration]
    write_whole(file, lambda partial: kept.to_csv(partial, index=False))
    return kept.to_dict("records")


def add_progress(file: Path, line: Mapping[str, Any]) -> None:
    """Append a line."""
    with named_failures(file), file.open("a", newline="", encoding="utf-8") as opened:
        csv.DictWriter(opened, COLUMNS, lineterminator="\n").writerow(line)
