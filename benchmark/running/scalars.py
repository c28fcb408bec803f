"""A run's progress for TensorBoard."""

from __future__ import annotations

import math
import shutil
import sys
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from tensorboardX.event_file_writer import EventsWriter
from tensorboardX.proto.event_pb2 import Event  # pyright: ignore[reportAttributeAccessIssue]
from tensorboardX.summary import scalar

SECONDS = 10
"""After which what was added is on disk with the next line."""
COUNTS = ("iteration", "agent_steps")
"""Columns that say when; the others are drawn over the agent-steps."""


class Scalars:
    """Writes the columns of progress.csv from the first line on, since a run may resume before its last line.

    If the files cannot be written, as on a full disk, the rest is left out: progress.csv has the same, and a
    run that resumes begins them again.

    Args:
        folder: Of TensorBoard's files; what is there is removed.
        lines: Of the progress so far.
    """

    def __init__(self, folder: Path, lines: Iterable[Mapping[Any, Any]]) -> None:
        # Not a `SummaryWriter`: its thread ends at the first failed write, and each further `add` blocks.
        self._writer: Any = None
        self._folder = folder
        self._flushed = time.monotonic()
        shutil.rmtree(folder, ignore_errors=True)
        with self._while_it_can_be_written():
            for left in folder.glob("events*"):  # of a folder that is a link
                left.unlink()
            folder.mkdir(parents=True, exist_ok=True)
            self._writer = EventsWriter(str(folder / "events"))
        for line in lines:
            self.add(line)

    def add(self, line: Mapping[Any, Any]) -> None:
        """Add a line; what is empty or not a number in it is left out."""
        if self._writer is None:
            return
        step, now = int(line["agent_steps"]), time.time()
        with self._while_it_can_be_written():
            for name, value in line.items():
                if name not in COUNTS and value != "" and math.isfinite(float(value)):
                    summary = scalar(name, float(value))
                    self._writer.write_event(Event(wall_time=now, step=step, summary=summary))
            if time.monotonic() - self._flushed > SECONDS:
                self._writer.flush()
                self._flushed = time.monotonic()

    def close(self) -> None:
        """Write what is left; may be called again."""
        if self._writer is not None:
            with self._while_it_can_be_written():
                self._writer.close()
        self._writer = None

    @contextmanager
    def _while_it_can_be_written(self) -> Iterator[None]:
        """Give up the files at the first failure."""
        try:
            yield
        except OSError as error:
            print(f"note: {self._folder}: no more curves for TensorBoard: {error}", file=sys.stderr)
            writer, self._writer = self._writer, None
            if writer is not None:
                with suppress(OSError):
                    writer.close()
