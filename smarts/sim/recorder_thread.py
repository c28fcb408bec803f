"""The thread that writes, so that the simulation does not wait for the disk."""

from __future__ import annotations

import os
import queue
import threading
from collections.abc import Callable

from smarts.errors import RecordError

Job = Callable[[], object]

_MOST_WAITING = 64
"""Queued jobs; `submit` blocks beyond this."""


class WriterThread:
    """Does jobs one after the other, and stops at the first that fails."""

    def __init__(self, place: str) -> None:
        self._place, self._owner = place, os.getpid()
        self._jobs: queue.Queue[Job | None] = queue.Queue(_MOST_WAITING)
        self._failure: Exception | None = None
        self._is_raised = False
        # A daemon, since Python joins other threads before its exit handlers run.
        self._thread = threading.Thread(target=self._work, name="episode-writer", daemon=True)
        self._thread.start()

    @property
    def is_here(self) -> bool:
        """Whether this is the thread's process, not one that was forked off."""
        return self._owner == os.getpid()

    def check_process(self) -> None:
        """Raise in a process that was forked off.

        Raises:
            RecordError: It is one.
        """
        if not self.is_here:
            raise RecordError(
                "a forked process cannot continue the recording of its parent",
                place=self._place,
                remedy="make the environment in the process that steps it",
            )

    def submit(self, job: Job) -> None:
        """Queue a job.

        Raises:
            RecordError: An earlier one failed; then nothing more is done. Or this is a forked process.
        """
        self._raise_failure()
        self.check_process()
        self._jobs.put(job)

    def close(self) -> None:
        """Wait until all is done, and end; may be called again.

        Raises:
            RecordError: A job failed and the error was not raised yet.
        """
        # The thread itself may drop the last reference to a recorder.
        if self._thread.is_alive() and threading.current_thread() is not self._thread:
            self._jobs.put(None)
            self._thread.join()
        if not self._is_raised:
            self._raise_failure()

    def _raise_failure(self) -> None:
        if self._failure is not None:
            self._is_raised = True
            raise RecordError(
                f"episodes cannot be written: {self._failure}",
                place=self._place,
                remedy="see that the folder can be written to and that the disk is not full",
            ) from self._failure

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            if self._failure is not None:
                continue
            try:
                job()
            except Exception as error:  # raised by `_raise_failure` in the thread that submits
                self._failure = error
