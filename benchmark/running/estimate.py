"""How long an experiment will take: from its budgets before it begins, then from what its jobs took."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from benchmark.experiment.config import Budget
from benchmark.experiment.runs import Run
from benchmark.results.plurals import counted
from benchmark.results.run_folder import FINISHED, TESTING, TRAINING

if TYPE_CHECKING:
    from benchmark.running.jobs import Job, JobState

ASSUMED = {TRAINING: 2500.0, TESTING: 2.5}
"""Agent-steps and episodes a second of jobs of which nothing is known yet: as on two cores of a server."""


def episodes_of(job: Job, variations: int) -> int:
    """Return the number of a job's test episodes.

    Args:
        job: The job.
        variations: Number of held-out variations in its test.
    """
    evaluation = job.task_setting.evaluation
    modes = len(evaluation.modes) if isinstance(job, Run) else 1
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
        steps, spent = (progress.agent_steps, progress.seconds) if progress else (0, 0.0)
        seconds = max(job.budget.most_steps - steps, 0) / rate(TRAINING)
        if job.budget.minutes:
            seconds = min(seconds, max(60 * job.budget.minutes - spent, 0.0))
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
