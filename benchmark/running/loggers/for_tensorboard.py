"""A run's progress for TensorBoard: `tensorboard --logdir results`."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterable, Mapping
from contextlib import suppress
from typing import Any

from tensorboardX.event_file_writer import EventsWriter
from tensorboardX.proto.event_pb2 import Event  # pyright: ignore[reportAttributeAccessIssue]
from tensorboardX.summary import scalar

from benchmark.running.loggers import Logged, numbers_of

SECONDS = 10
"""Time after which the next line flushes what was added to the disk [s]."""


class TensorBoard:
    """Writes the columns of progress.csv into the run's folder `tensorboard`.

    Args:
        logged: The training; what an earlier part of it has written is removed.
        lines: Lines of the progress so far.
    """

    def __init__(self, logged: Logged, lines: Iterable[Mapping[Any, Any]]) -> None:
        self._folder = logged.folder / "tensorboard"
        self._flushed = time.monotonic()
        shutil.rmtree(self._folder, ignore_errors=True)
        self._folder.mkdir(parents=True, exist_ok=True)
        # Not a `SummaryWriter`: its thread ends at the first failed write, and each further `add` blocks.
        self._writer = EventsWriter(str(self._folder / "events"))
        for line in lines:
            self.add(line)

    def add(self, line: Mapping[Any, Any]) -> None:
        """Add a line."""
        step, now = int(line["agent_steps"]), time.time()
        for name, value in numbers_of(line):
            self._writer.write_event(Event(wall_time=now, step=step, summary=scalar(name, value)))
        if time.monotonic() - self._flushed > SECONDS:
            self._writer.flush()
            self._flushed = time.monotonic()

    def close(self) -> None:
        """Write what is left, if the disk has room: progress.csv has the same."""
        with suppress(OSError):
            self._writer.close()
