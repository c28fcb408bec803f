"""Schedules the jobs of an experiment as Ray tasks; each resumes where it was interrupted."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import ray
from ray.exceptions import RayError, RayTaskError

from benchmark.experiment.config import Experiment, Resources
from benchmark.experiment.runs import Run, ScriptedRun, runs_of, scripted_runs_of
from benchmark.results.run_folder import FINISHED, TESTING, TRAINING, RunFolder
from benchmark.running.importing import named_own_code
from benchmark.running.progress import STARTING, WAITING, RunProgress
from smarts.errors import SmartsError, shortened
from smarts.registry import import_own

ATTEMPTS = 3
"""How often a job may lose its process before it has failed."""

STOP = ".stop"
"""File in an experiment's folder at which its runs save and end; all machines of a cluster see it."""
STOP_SECONDS = 60.0
"""Time limit for saving: an iteration, a validation and a checkpoint [s]."""

Job = Run | ScriptedRun


@dataclass
class JobState:
    """State of a job while an experiment runs."""

    job: Job
    status: str = WAITING
    """`WAITING`, `STARTING`, a phase of `RunProgress`, or "failed"."""
    progress: RunProgress | None = None
    attempts: int = 0
    error: str = ""
    updates: Any = field(default=None, repr=False)
    """The stream of its progress."""


def jobs_of(experiment: Experiment) -> list[Job]:
    """Return all jobs of an experiment in the order in which they start."""
    return [*scripted_runs_of(experiment), *runs_of(experiment)]


class JobScheduler:
    """Runs as many jobs side by side as resources allow.

    Args:
        jobs: All jobs; finished ones are skipped.
        root: Folder of the experiment's results.
        resources: Needed by each run.
        show: Called with the states of all jobs when one changes.

    Raises:
        ResultsError: A job's folder holds other results.
    """

    def __init__(
        self,
        jobs: Sequence[Job],
        root: Path,
        resources: Resources,
        show: Callable[[Sequence[JobState]], None] = lambda states: None,
    ) -> None:
        self.states = [JobState(job) for job in jobs]
        self._root, self._resources, self._show = root.absolute(), resources, show
        self._waiting: deque[JobState] = deque()
        self._under_way: dict[Any, JobState] = {}
        for state in self.states:
            folder = RunFolder(self._root / state.job.folder)
            content = state.job.content()
            folder.check(content)
            if folder.is_finished(state.job.task_setting.test_content()) and not folder.is_extended(content):
                state.status = FINISHED
            else:
                self._waiting.append(state)

    @property
    def is_done(self) -> bool:
        """Whether all jobs are finished."""
        return not self._waiting

    def run(self) -> list[JobState]:
        """Run all jobs; return their states, with the errors of failed jobs."""
        parallel = self._resources.parallel or self._fitting()
        (self._root / STOP).unlink(missing_ok=True)
        self._show(self.states)
        while self._waiting or self._under_way:
            while self._waiting and len(self._under_way) < parallel:
                state = self._waiting.popleft()
                self._begin(state)
                self._under_way[state.updates] = state
            self._listen([*self._under_way])
            self._show(self.states)
        return self.states

    def stop(self) -> None:
        """Wait at most `STOP_SECONDS` until training runs have saved; other jobs have nothing to save."""
        deadline, file = time.monotonic() + STOP_SECONDS, self._root / STOP
        file.touch()
        try:
            while (training := self._training()) and time.monotonic() < deadline:
                self._listen(training)
        finally:
            file.unlink(missing_ok=True)

    def _training(self) -> list[Any]:
        """Return the streams of runs that train, or may train without having reported it yet."""
        states = self._under_way.items()
        return [
            stream
            for stream, state in states
            if isinstance(state.job, Run) and state.status in (STARTING, TRAINING)
        ]

    def _listen(self, streams: Sequence[Any]) -> None:
        """Receive a message of one of the jobs, if one arrives within a second."""
        ready, _ = ray.wait([*streams], num_returns=1, timeout=1.0)
        for stream in ready:
            if not self._take(self._under_way[stream]):
                del self._under_way[stream]

    def _fitting(self) -> int:
        needed = 1 + self._resources.env_runners
        return max(1, int(ray.cluster_resources().get("CPU", 1)) // needed)

    def _begin(self, state: JobState) -> None:
        state.attempts += 1
        state.status = STARTING
        gpus = self._resources.learner_gpus
        task = _execute.options(num_cpus=1, num_gpus=gpus, max_retries=0, num_returns="streaming")
        state.updates = task.remote(state.job, str(self._root))

    def _take(self, state: JobState) -> bool:
        """Receive a message of a job; return whether more will follow."""
        try:
            progress: Any = ray.get(next(state.updates))
            state.progress, state.status = progress, progress.phase
            return True
        except StopIteration:
            state.status = FINISHED
        except RayTaskError as error:
            state.status, state.error = "failed", _words(error.cause or error)
        except RayError as error:
            # The process was killed, by a user or for want of memory; its checkpoint remains.
            if state.attempts < ATTEMPTS:
                self._waiting.appendleft(state)
                state.status = WAITING
            else:
                state.status, state.error = "failed", f"lost its process {ATTEMPTS} times: {_words(error)}"
        return False


def _words(error: BaseException) -> str:
    kind = "" if isinstance(error, SmartsError) else f"{type(error).__name__}: "
    return shortened(f"{kind}{error}")


@ray.remote
def _execute(job: Job, root: str) -> Iterator[RunProgress]:
    """Run a job in a process of its own; yield its progress."""
    # Imported here, so that the driver's process loads neither torch nor the simulation.
    from benchmark.running.testing import play_scripted
    from benchmark.running.training import train_and_evaluate

    import_own(job.task_setting.imports)
    folder = RunFolder(Path(root) / job.folder)
    with named_own_code("the run's own code"):
        if isinstance(job, Run):
            yield from train_and_evaluate(job, folder, (Path(root) / STOP).exists)
        else:
            for share in play_scripted(job, folder):
                yield RunProgress(TESTING, share)
