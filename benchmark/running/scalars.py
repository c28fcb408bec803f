"""A run's progress for TensorBoard."""

from __future__ import annotations

import math
import shutil
import time
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from tensorboardX.event_file_writer import EventsWriter
from tensorboardX.proto.event_pb2 import Event  # pyright: ignore[reportAttributeAccessIssue]
from tensorboardX.summary import scalar

from benchmark.results.files import named_failures

SECONDS = 10
"""Time after which the next line flushes what was added to the disk [s]."""
COUNTS = ("iteration", "agent_steps")
"""Columns that say when; the others are drawn over the agent-steps."""


class Scalars:
    """Writes the columns of progress.csv from the first line on, since a run may resume before its last line.

    Args:
        folder: Folder of TensorBoard's files; what is there is removed.
        lines: Lines of the progress so far.

    Raises:
        ResultsError: The disk is full, or the folder cannot be written to.
    """

    def __init__(self, folder: Path, lines: Iterable[Mapping[Any, Any]]) -> None:
        self._folder = folder
        self._flushed = time.monotonic()
        shutil.rmtree(folder, ignore_errors=True)
        with named_failures(folder):
            folder.mkdir(parents=True, exist_ok=True)
            # Not a `SummaryWriter`: its thread ends at the first failed write, and each further `add` blocks.
            self._writer = EventsWriter(str(folder / "events"))
        for line in lines:
            self.add(line)

    def add(self, line: Mapping[Any, Any]) -> None:
        """Add a line; what is empty or not a number in it is left out."""
        step, now = int(line["agent_steps"]), time.time()
        with named_failures(self._folder):
            for name, value in line.items():
                if name not in COUNTS and value != "" and math.isfinite(float(value)):
                    summary = scalar(name, float(value))
                    self._writer.write_event(Event(wall_time=now, step=step, summary=summary))
            if time.monotonic() - self._flushed > SECONDS:
                self._writer.flush()
                self._flushed = time.monotonic()

    def close(self) -> None:
        """Write what is left, if the disk has room: progress.csv has the same."""
        with suppress(OSError):
            self._writer.close()
