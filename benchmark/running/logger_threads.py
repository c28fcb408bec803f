"""Calls loggers from threads of their own: a server that does not answer holds up nothing else."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import cache
from queue import Full, Queue
from threading import Event, Thread

MOST_WAITING = 1000
"""Calls of a logger that may wait; further ones are left out."""
PATIENCE = 10.0
"""Time that the end of a training waits for a logger [s]."""


class LoggerThread:
    """Makes the calls of a logger one after another; they must not raise.

    Args:
        name: The logger's name.
    """

    def __init__(self, name: str) -> None:
        self._name, self._is_full, self._late = name, False, Event()
        self._late.set()
        self._calls: Queue[Callable[[], object]] = Queue(MOST_WAITING)
        Thread(target=self._work, name=f"logger {name}", daemon=True).start()

    def add(self, call: Callable[[], object]) -> None:
        """Make a call later; if too many wait, leave it out, which is said once."""
        try:
            self._calls.put_nowait(call)
        except Full:
            if not self._is_full:
                self._is_full = True
                print(f"note: the logger {self._name} does not answer: lines are left out", file=sys.stderr)

    def wait(self, patience: float = PATIENCE) -> None:
        """Wait until the calls so far are made; no longer than `patience` [s], and not twice for one call."""
        if not self._late.is_set():
            return
        self._late = Event()
        self.add(self._late.set)
        if not self._late.wait(patience):
            print(f"note: the logger {self._name} does not answer: it may lack lines", file=sys.stderr)

    def _work(self) -> None:
        while True:
            self._calls.get()()


logger_thread = cache(LoggerThread)
"""The thread of a logger of a name, which all runs share."""
