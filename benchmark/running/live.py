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
from benchmark.running.estimate import ends, seconds_left
from benchmark.running.messages import STARTING, WAITING

if TYPE_CHECKING:
    from benchmark.running.jobs import JobState

MOST_ROWS = 12
"""Rows of the table."""
STARTS = "waits for free CPUs, loads, and compiles kernels where `smarts-bench compile` has not run"
"""What a starting job does; shown for the first one."""
SECONDS = 30.0
"""Time between two lines of a job if the output is no terminal [s]."""
OUTCOMES = ("return", "completion", "collision")
COLUMNS = ("done", "iteration", "agent-steps/s", *OUTCOMES, "training left")
"""Columns of the table, beside the run and its phase."""
TOTAL_SECONDS = 60.0
"""Time between two lines about all jobs if the output is no terminal [s]."""
SILENCE = 300.0
"""Time without a message of a job that trains or is tested, after which a line says so [s]."""


class LiveProgress:
    """Shows the progress of jobs: a live table in a terminal, else lines.

    A job has a line at each change of its state, and every 30 s if there is something new to say.
    """

    def __init__(self, console: Console | None = None) -> None:
        self._console = console or Console(stderr=True)
        self._live = Live(console=self._console, auto_refresh=False, transient=True)
        self._began = time.monotonic()
        self._has_explained = False
        self._totalled = self._began
        self._said: dict[str, tuple[str, str, float]] = {}
        """Job -> its last line: status, text and time."""

    def __enter__(self) -> LiveProgress:
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    def show(self, states: Sequence[JobState], at_once: int) -> None:
        """Show the states.

        Args:
            states: States of all jobs.
            at_once: How many run side by side.
        """
        if self._console.is_terminal:
            self._live.update(self._table(states, at_once), refresh=True)
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
                self._print(line)
        if time.monotonic() - self._totalled > TOTAL_SECONDS:
            self._totalled = time.monotonic()
            self._print(self._total(states, at_once))

    def _print(self, line: str) -> None:
        # Without a terminal rich assumes a width of 80: do not wrap.
        self._console.print(line, highlight=False, markup=False, soft_wrap=True)

    def _total(self, states: Sequence[JobState], at_once: int) -> str:
        done = sum(state.status == FINISHED for state in states)
        minutes = (time.monotonic() - self._began) / 60
        left = ends(seconds_left(states, at_once))
        return f"{done} of {len(states)} runs finished after {minutes:.0f} min; {left}"

    def _table(self, states: Sequence[JobState], at_once: int) -> Table:
        table = Table(title=self._total(states, at_once), title_justify="left")
        for title in ("run", "phase", *COLUMNS):
            table.add_column(title, justify="left" if title in ("run", "phase") else "right")
        busy = [state for state in states if state.status not in (FINISHED, WAITING)]
        waiting = [state for state in states if state.status == WAITING]
        for state in [*busy, *waiting][:MOST_ROWS]:
            numbers = _numbers(state)
            cells = (
                [state.error.partition("\n")[0]]
                if state.error
                else [numbers.get(each, "") for each in COLUMNS]
            )
            table.add_row(str(state.job), _silence(state) or state.status, *cells)
        if len(busy) + len(waiting) > MOST_ROWS:
            table.add_row(f"and {len(busy) + len(waiting) - MOST_ROWS} more")
        return table


def _line(state: JobState) -> str:
    """Return the progress of a job as a line."""
    text, numbers = f"{state.job}: {state.status}", _numbers(state)
    if state.error:
        return f"{text}: {state.error}"
    if state.status == STARTING and state.iteration:
        return f"{text}, continues after iteration {state.iteration}"
    if not numbers:
        return text
    text += f" {numbers['done']}"
    if silence := _silence(state):
        return f"{text}, {silence}"
    if state.status == TESTING:
        return text
    text += f", iteration {numbers['iteration']}, {numbers['agent-steps/s']} agent-steps/s"
    text += "".join(f", {name} {numbers[name]}" for name in OUTCOMES if name in numbers)
    return f"{text}, {numbers['training left']} of training left"


def _silence(state: JobState) -> str:
    """Return for how long nothing has been heard of a job that has begun; empty if that is not long."""
    silent = time.monotonic() - state.heard if state.status in (TRAINING, TESTING) else 0.0
    return (
        f"no message for {silent // 60:.0f} min (docs/guide/troubleshooting.md)" if silent > SILENCE else ""
    )


def _numbers(state: JobState) -> dict[str, str]:
    """Return what is known of a job that trains or is tested, by columns of the table."""
    progress = state.progress
    if progress is None or state.status not in (TRAINING, TESTING):
        return {}
    numbers = {"done": f"{progress.share:.0%}"}
    if state.status == TESTING:
        return numbers
    # Not finite until the first episode has ended.
    outcomes = {
        "return": progress.returns,
        "completion": progress.completion,
        "collision": progress.collision,
    }
    left = progress.seconds * (1 / progress.share - 1) if progress.share else math.inf
    return {
        **numbers,
        "iteration": str(progress.iteration),
        "agent-steps/s": f"{progress.agent_steps_per_second:,.0f}",
        **{name: f"{value:z.2f}" for name, value in outcomes.items() if math.isfinite(value)},
        "training left": f"{left / 60:.1f} min",
    }
