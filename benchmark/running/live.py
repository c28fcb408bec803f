"""Live progress of an experiment in the terminal, and how long it will take."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from rich.console import Console
from rich.live import Live
from rich.table import Table

from benchmark.experiment.models import Budget
from benchmark.experiment.runs import Run
from benchmark.results.plurals import counted
from benchmark.results.run_folder import FINISHED, TESTING, TRAINING
from benchmark.running.messages import STARTING, WAITING

if TYPE_CHECKING:
    from benchmark.running.jobs import Job, JobState

ASSUMED = {TRAINING: 2500.0, TESTING: 2.5}
"""Agent-steps and episodes a second of jobs of which nothing is known yet: as on two cores of a server."""
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
        # Notebooks set FORCE_COLOR, by which rich takes their output for a terminal.
        self._console = console or Console(stderr=True, force_terminal=sys.stderr.isatty())
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
    line = progress.line
    left = line["seconds"] * (1 / progress.share - 1) if progress.share else math.inf
    return {
        **numbers,
        "iteration": str(line["iteration"]),
        "agent-steps/s": f"{line['agent_steps_per_second']:,.0f}",
        # Not finite until the first episode has ended.
        **{name: f"{line[name]:z.2f}" for name in OUTCOMES if math.isfinite(line[name])},
        "training left": f"{left / 60:.1f} min",
    }


def episodes_of(job: Job, variations: int) -> int:
    """Return the number of a job's test episodes.

    Args:
        job: The job.
        variations: Number of held-out variations in its test.
    """
    evaluation = job.task_setting.evaluation
    modes = len(evaluation.modes) if isinstance(job, Run) else 1
    modes *= max(1, len(job.task_setting.task.test))
    return evaluation.episodes * modes + evaluation.held_out_episodes * variations


def seconds_left(states: Sequence[JobState], at_once: int) -> float:
    """Return how long jobs will take until all are finished [s].

    A job that has not begun is taken to be as fast as those of its name, or else as all others.

    Args:
        states: States of all jobs.
        at_once: How many run side by side.
    """
    known = _rates(states)
    left = [_job_left(state, known) for state in states if state.status not in (FINISHED, "failed")]
    return max(sum(left) / max(at_once, 1), *left, 0.0)


def _rates(states: Sequence[JobState]) -> dict[tuple[str, str], float]:
    """Return agent-steps and episodes a second: means by phase and name, and by phase and "" of all."""
    found: dict[tuple[str, str], list[float]] = {}
    for state in states:
        for phase, rate in state.rates.items():
            found.setdefault((phase, state.job.label), []).append(rate)
            found.setdefault((phase, ""), []).append(rate)
    return {key: math.fsum(rates) / len(rates) for key, rates in found.items()}


def _job_left(state: JobState, known: Mapping[tuple[str, str], float]) -> float:
    """Return how long a job will take from now on [s]."""

    def rate(phase: str) -> float:
        every = known.get((phase, ""), ASSUMED[phase])
        return state.rates.get(phase) or known.get((phase, state.job.label), every)

    job, progress = state.job, state.progress
    if progress is not None and progress.phase == TESTING:
        return state.episodes * (1 - progress.share) / rate(TESTING)
    seconds, episodes = 0.0, float(state.episodes)
    if isinstance(job, Run):
        line = progress.line if progress else {}
        seconds = max(job.budget.most_steps - line.get("agent_steps", 0), 0) / rate(TRAINING)
        if job.budget.minutes:
            seconds = min(seconds, max(60 * job.budget.minutes - line.get("seconds", 0.0), 0.0))
        evaluation = job.task_setting.evaluation
        validations = evaluation.validations * evaluation.validation_episodes
        episodes += validations * (1 - (progress.share if progress else 0.0))
    return seconds + episodes / rate(TESTING)


def plan(states: Sequence[JobState], at_once: int) -> str:
    """Return in a line what is to be done, and when it will end."""
    waiting = [state for state in states if state.status != FINISHED]
    tasks = {str(state.job.task_setting) for state in waiting}
    runs = [state.job for state in waiting if isinstance(state.job, Run)]
    scripted = len(waiting) - len(runs)
    parts = [
        f"{counted(len(runs), 'training')} in {counted(len(tasks), 'task')}",
        *dict.fromkeys(_words(run.budget) for run in runs),
        *([counted(scripted, "test") + " of scripted policies"] if scripted else []),
        counted(sum(state.episodes for state in waiting), "test episode"),
        f"{min(at_once, len(waiting))} at a time",
    ]
    return f"plan: {', '.join(parts)}; {ends(seconds_left(states, at_once))}"


def _words(budget: Budget) -> str:
    steps = [f"{budget.agent_steps:,} agent-steps"] if budget.agent_steps else []
    minutes = [f"{budget.minutes:g} minutes"] if budget.minutes else []
    return f"each of {' or '.join(steps + minutes)}"


def ends(left: float) -> str:
    """Return when that which takes this long from now [s] will end, in words."""
    at = time.localtime(time.time() + left)
    clock = time.strftime("%H:%M" if left < 12 * 3600 else "%d %b %H:%M", at)
    return f"ends about {clock}, in {f'{left / 60:.0f} min' if left < 7200 else f'{left / 3600:.0f} h'}"
