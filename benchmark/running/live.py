"""Live progress of an experiment in the terminal, and how long it will take."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from rich.console import Console
from rich.live import Live
from rich.text import Text

from benchmark.experiment.models import Budget
from benchmark.experiment.runs import SCRIPTED, Run
from benchmark.results.plurals import counted
from benchmark.results.run_folder import FINISHED, TESTING, TRAINING
from benchmark.running.messages import STARTING, WAITING
from benchmark.running.testing import parts_of

if TYPE_CHECKING:
    from benchmark.running.jobs import Job, JobState

STEPS, EPISODES = 2500.0, 2.5
"""Agent-steps and test episodes a second of which a plan is made: those of two cores of a server."""
TRAINED = 0.9
"""Share of a training in its job; the rest is its test."""
MOST_ROWS = 12
"""Lines of a terminal about jobs."""
STARTS = "waits for free CPUs, loads, and compiles kernels where `smarts-bench compile` has not run"
"""What a starting job does; shown for the first one."""
SECONDS = 30.0
"""Time between two lines of a job if the output is no terminal [s]."""
OUTCOMES = ("return", "completion", "collision")
TOTAL_SECONDS = 60.0
"""Time between two lines about all jobs if the output is no terminal [s]."""
ENOUGH = 0.02
"""Share of what was left that has to be done before an end is estimated: starting and compiling are slow."""
SILENCE = 300.0
"""Time without a message of a job that trains or is tested, after which a line says so [s]."""


class LiveProgress:
    """Shows the progress of jobs, a line each: in a terminal the latest ones, else one below the other.

    A job has a line at each change of its state, and every 30 s if there is something new to say.
    """

    def __init__(self, console: Console | None = None) -> None:
        # Notebooks set FORCE_COLOR, by which rich takes their output for a terminal.
        self._console = console or Console(stderr=True, force_terminal=sys.stderr.isatty())
        self._live = Live(console=self._console, auto_refresh=False, transient=True)
        self._began = time.monotonic()
        self._first: float | None = None
        """Share of the jobs that was done at the beginning."""
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

    def show(self, states: Sequence[JobState]) -> None:
        """Show the states.

        Args:
            states: States of all jobs.
        """
        if self._first is None:
            self._first = share_done(states)
        if self._console.is_terminal:
            self._live.update(Text("\n".join(self._lines(states))), refresh=True)
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
            self._print(self._total(states))

    def _print(self, line: str) -> None:
        # Without a terminal rich assumes a width of 80: do not wrap.
        self._console.print(line, highlight=False, markup=False, soft_wrap=True)

    def _total(self, states: Sequence[JobState]) -> str:
        """Return a line with the number of finished jobs and the estimated end, at the speed so far."""
        finished, done = sum(state.status == FINISHED for state in states), share_done(states)
        took = time.monotonic() - self._began
        text = f"{finished} of {len(states)} runs finished after {took / 60:.0f} min"
        first = done if self._first is None else self._first
        gained = done - first
        return f"{text}; {ends(took * (1 - done) / gained)}" if gained > ENOUGH * (1 - first) else text

    def _lines(self, states: Sequence[JobState]) -> Iterator[str]:
        """Yield what a terminal shows: a line about all jobs, then one for each that is not finished."""
        yield self._total(states)
        left = [state for state in states if state.status != FINISHED]
        left.sort(key=lambda state: state.status == WAITING)
        yield from map(_line, left[:MOST_ROWS])
        if len(left) > MOST_ROWS:
            yield f"and {len(left) - MOST_ROWS} more"


def _line(state: JobState) -> str:
    """Return the progress of a job as a line."""
    text, progress = f"{state.job}: {state.status}", state.progress
    if state.error:
        return f"{text}: {state.error}"
    if state.status == STARTING and state.iteration:
        return f"{text}, continues after iteration {state.iteration}"
    if progress is None or state.status not in (TRAINING, TESTING):
        return text
    text += f" {progress.share:.0%}"
    if (silent := time.monotonic() - state.heard) > SILENCE:
        return f"{text}, no message for {silent // 60:.0f} min (docs/guide/troubleshooting.md)"
    if state.status == TESTING:
        return text
    line = progress.line
    text += f", iteration {line['iteration']}, {line['agent_steps_per_second']:,.0f} agent-steps/s"
    # Not finite until the first episode has ended.
    text += "".join(f", {name} {line[name]:z.2f}" for name in OUTCOMES if math.isfinite(line[name]))
    left = line["seconds"] * (1 / progress.share - 1) if progress.share else math.inf
    return f"{text}, {left / 60:.1f} min of training left"


def share_done(states: Sequence[JobState]) -> float:
    """Return the share of all jobs that is done; a failed one is over."""

    def share(state: JobState) -> float:
        if state.status in (FINISHED, "failed"):
            return 1.0
        if state.progress is None or not isinstance(state.job, Run):
            return state.progress.share if state.progress else 0.0
        is_test = state.progress.phase == TESTING
        return TRAINED * is_test + ((1 - TRAINED) if is_test else TRAINED) * state.progress.share

    return sum(map(share, states)) / len(states)


def plan(states: Sequence[JobState], at_once: int) -> str:
    """Return in a line what is to be done, and when it will end on a usual machine."""
    waiting = [state for state in states if state.status != FINISHED]
    tasks = {str(state.job.task_setting) for state in waiting}
    runs = [state.job for state in waiting if isinstance(state.job, Run)]
    scripted = len(waiting) - len(runs)
    parts = [
        f"{counted(len(runs), 'training')} in {counted(len(tasks), 'task')}",
        *dict.fromkeys(_words(run.budget) for run in runs),
        *([counted(scripted, "test") + " of scripted policies"] if scripted else []),
        counted(sum(_test_episodes(state.job) for state in waiting), "test episode"),
        f"{min(at_once, len(waiting))} at a time",
    ]
    took = [_usual_seconds(state.job) for state in waiting]
    return f"plan: {', '.join(parts)}; {ends(max(sum(took) / max(at_once, 1), *took))}"


def _test_episodes(job: Job) -> int:
    """Return the number of a job's test episodes."""
    modes = job.task_setting.evaluation.modes if isinstance(job, Run) else (SCRIPTED,)
    return sum(part.episodes for part in parts_of(job.task_setting, modes))


def _usual_seconds(job: Job) -> float:
    """Return how long a job takes on a usual machine [s]."""
    seconds, episodes = 0.0, _test_episodes(job)
    if isinstance(job, Run):
        minutes = job.budget.minutes or math.inf
        seconds = min(job.budget.most_steps / STEPS, 60 * minutes)
        evaluation = job.task_setting.evaluation
        episodes += evaluation.validations * evaluation.validation_episodes
    return seconds + episodes / EPISODES


def _words(budget: Budget) -> str:
    steps = [f"{budget.agent_steps:,} agent-steps"] if budget.agent_steps else []
    minutes = [f"{budget.minutes:g} minutes"] if budget.minutes else []
    return f"each of {' or '.join(steps + minutes)}"


def ends(left: float) -> str:
    """Return when that which takes this long from now [s] will end, in words."""
    at = time.localtime(time.time() + left)
    clock = time.strftime("%H:%M" if left < 12 * 3600 else "%d %b %H:%M", at)
    return f"ends about {clock}, in {f'{left / 60:.0f} min' if left < 7200 else f'{left / 3600:.0f} h'}"
