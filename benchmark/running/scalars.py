"""A run's progress for TensorBoard."""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from tensorboardX import SummaryWriter

SECONDS = 10
"""After which what was added is on disk at the latest."""
COUNTS = ("iteration", "agent_steps")
"""Columns that say when; the others are drawn over the agent-steps."""


class Scalars:
    """Writes the columns of progress.csv from the first line on, since a run may resume before its last line.

    Args:
        folder: Of TensorBoard's files; what is there is removed.
        lines: Of the progress so far.
    """

    def __init__(self, folder: Path, lines: Iterable[Mapping[Any, Any]]) -> None:
        shutil.rmtree(folder, ignore_errors=True)
        self._writer = SummaryWriter(str(folder), flush_secs=SECONDS)
        for line in lines:
            self.add(line)

    def add(self, line: Mapping[Any, Any]) -> None:
        """Add a line; what is empty or not a number in it is left out."""
        for name, value in line.items():
            if name not in COUNTS and value != "" and math.isfinite(float(value)):
                self._writer.add_scalar(name, float(value), int(line["agent_steps"]))

    def close(self) -> None:
        """Write what is left."""
        self._writer.close()
