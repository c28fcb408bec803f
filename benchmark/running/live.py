"""Live progress of an experiment in the terminal."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

from rich.console import Console
from rich.live import Live
from rich.table import Table

from benchmark.results.run_folder import FINISHED, TESTING, TRAINING
from benchmark.running.progress import STARTING, WAITING

if TYPE_CHECKING:
    from benchmark.running.jobs import JobState

MOST_ROWS = 12
"""Rows of the table."""
STARTS = "waits for free CPUs, loads, and compiles kernels where `smarts-bench compile` has not run"
"""What a job does that starts; said of the first one."""
SECONDS = 30.0
"""Between two lines of a job if the output is no terminal."""
SILENCE = 300.0
"""Without any message of a job that trains or is tested, after which this is said [s]."""


class LiveProgress:
    """Shows the progress of jobs: a live table in a terminal, else lines.

    A job has a line at each change of its state, and every 30 s if there is something new to say.
    """

    def __init__(self, console: Console | None = None) -> None:
        self._console = console or Console(stderr=True)
        self._live = Live(console=self._console, auto_refresh=False, transient=True)
        self._began = time.monotonic()
        self._has_explained = False
        self._said: dict[str, tuple[str, str, float]] = {}
        """Job -> its last line: status, text and time."""

    def __enter__(self) -> LiveProgress:
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    def show(self, states: Sequence[JobState]) -> None:
        """Show the states."""
        if self._console.is_terminal:
            self._live.update(self._table(states), refresh=True)
            return
        for state in states:
            name = str(state.job)
            before, text, at = self._said.get(name, (WAITING, "", -math.inf))
            is_due = state.status in (TRAINING, TESTING) and time.monotonic() - at > SECONDS
            if state.status == before and not is_due:
                continue
            line = _line(state)
            if state.status == STARTING and not self._has_explained:
                self._has_explained, line = True, f"{line} ({STARTS})"
            self._said[name] = state.status, line, time.monotonic()
            if line != text:
                # Without a terminal rich assumes a width of 80: do not wrap.
                self._console.print(line, highlight=False, markup=False, soft_wrap=True)

    def _table(self, states: Sequence[JobState]) -> Table:
        done = sum(state.status == FINISHED for state in states)
        minutes = (time.monotonic() - self._began) / 60
        table = Table(title=f"{done} of {len(states)} runs finished, {minutes:.0f} min", title_justify="left")
        for title in (
            "run",
            "phase",
            "done",
            "iteration",
            "agent-steps/s",
            "return",
            "completion",
            "collision",
            "training left",
        ):
            table.add_column(title, justify="left" if title in ("run", "phase") else "right")
        busy = [state for state in states if state.status not in (FINISHED, WAITING)]
        waiting = [state for state in states if state.status == WAITING]
        for state in [*busy, *waiting][:MOST_ROWS]:
            table.add_row(*_cells(state))
        if len(busy) + len(waiting) > MOST_ROWS:
            table.add_row(f"and {len(busy) + len(waiting) - MOST_ROWS} more")
        return table


def _line(state: JobState) -> str:
    """Return the progress of a job as a line."""
    progress, text = state.progress, f"{state.job}: {state.status}"
    if state.status == "failed":
        return f"{text}: {state.error}"
    if state.status == STARTING and state.iteration:
        return f"{text}, continues after iteration {state.iteration}"
    if progress is None or state.status not in (TRAINING, TESTING):
        return text
    text += f" {progress.share:.0%}"
    if silence := _silence(state):
        return f"{text}, {silence}"
    if state.status == TESTING:
        return text
    _, _, _, iteration, speed, returns, completion, collision, left = _cells(state)
    text += f", iteration {iteration}, {speed} agent-steps/s"
    outcomes = {"return": returns, "completion": completion, "collision": collision}
    text += "".join(f", {name} {value}" for name, value in outcomes.items() if value)
    return f"{text}, {left} of training left" if left else text


def _silence(state: JobState) -> str:
    """Return for how long nothing has been heard of a job; empty if that is not long."""
    silent = time.monotonic() - state.heard
    return f"no message for {silent // 60:.0f} min (docs/troubleshooting.md)" if silent > SILENCE else ""


def _cells(state: JobState) -> list[str]:
    progress = state.progress
    if state.status == "failed":
        return [str(state.job), "failed", state.error.splitlines()[0] if state.error else ""]
    if progress is None:
        return [str(state.job), state.status]
    if progress.phase != TRAINING:
        return [str(state.job), _silence(state) or progress.phase, f"{progress.share:.0%}"]
    left = progress.seconds * (1 / progress.share - 1) if progress.share else math.nan
    return [
        str(state.job),
        _silence(state) or progress.phase,
        f"{progress.share:.0%}",
        str(progress.iteration),
        f"{progress.agent_steps_per_second:,.0f}",
        # Empty until the first episode has ended.
        *(
            f"{value:z.2f}" if math.isfinite(value) else ""
            for value in (progress.returns, progress.completion, progress.collision)
        ),
        f"{left / 60:.1f} min" if math.isfinite(left) else "",
    ]
