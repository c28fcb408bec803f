"""Schedules the jobs of an experiment as Ray tasks; each resumes where it was interrupted."""

from __future__ import annotations

import os
import shutil
import signal
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import ray
from ray.exceptions import RayError, RayTaskError
from ray.util.placement_group import placement_group, remove_placement_group
from ray.util.scheduling_strategies import PlacementGroupSchedulingStrategy

from benchmark.experiment.models import Experiment, Resources
from benchmark.experiment.runs import Run, ScriptedRun, runs_of, scripted_runs_of
from benchmark.results.files import write_files
from benchmark.results.reading import packed_contents, run_folder
from benchmark.results.run_folder import CHECKPOINT, FINISHED, TRAINING, RunFolder
from benchmark.running.cluster import check_ray, check_room, is_stopping, learners_on, living_nodes, stopping
from benchmark.running.importing import named_own_code
from benchmark.running.messages import BACKLOG, STARTING, WAITING, Kept, Message, RunProgress
from benchmark.running.signals import handled
from benchmark.running.writing import RunWriter
from smarts.errors import SmartsError, shortened
from smarts.locked_folders import make_locked, remove_left
from smarts.registry import import_own

ATTEMPTS = 3
"""How often a job may lose its process, without a checkpoint in between, before it has failed."""
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
    """Number of attempts since its last checkpoint."""
    iteration: int = 0
    """Iteration of the checkpoint that the job continues from; 0: it begins."""
    heard: float = 0.0
    """Time of its last message, by the monotonic clock [s]."""
    error: str = ""
    folder: Any = field(default=None, repr=False)
    """The run's folder, or its packed results."""
    updates: Any = field(default=None, repr=False)
    """The stream of its messages."""
    room: Any = field(default=None, repr=False)
    """The placement group of its resources."""
    writer: Any = field(default=None, repr=False)
    """A `RunWriter`, once it has begun."""


def jobs_of(experiment: Experiment) -> list[Job]:
    """Return all jobs of an experiment in the order in which they start: what takes longest comes first."""
    return [*runs_of(experiment), *scripted_runs_of(experiment)]


class JobScheduler:
    """Runs as many jobs side by side as resources allow, and writes their results.

    Args:
        jobs: All jobs; finished ones are skipped.
        root: Folder of the experiment's results.
        resources: Needed by each run.
        loggers: Names of what shows their progress.
        show: Called with the states of all jobs when one changes.

    Raises:
        ResultsError: A job's folder holds other results, or cannot be written.
    """

    def __init__(
        self,
        jobs: Sequence[Job],
        root: Path,
        resources: Resources,
        loggers: Sequence[str] = (),
        show: Callable[[Sequence[JobState]], None] = lambda states: None,
    ) -> None:
        self.states = [JobState(job) for job in jobs]
        packed = packed_contents(root)
        self._root, self._resources, self._show = root.absolute(), resources, show
        self._loggers = loggers
        self._waiting: deque[JobState] = deque()
        self._under_way: dict[Any, JobState] = {}
        self._free_rooms: list[Any] = []
        for state in self.states:
            folder = state.folder = run_folder(self._root, state.job.folder, packed)
            content = state.job.content()
            folder.check(content)
            setting = state.job.task_setting
            is_kept = not setting.evaluation.keep_episodes or folder.has_episodes
            if is_kept and folder.is_finished(setting.test_content()) and not folder.is_extended(content):
                state.status = FINISHED
            else:
                folder.check_start(content)
                self._waiting.append(state)

    @property
    def is_done(self) -> bool:
        """Whether all jobs are finished."""
        return not self._waiting

    def run(self) -> list[JobState]:
        """Run all jobs; return their states, with the errors of failed jobs.

        Raises:
            ResultsError: Ray's own processes are lost.
        """
        self._report()
        while self._waiting or self._under_way:
            check_ray()
            while self._waiting and len(self._under_way) < self.most_at_once():
                self._begin(self._waiting.popleft())
            while self._free_rooms:  # another run may wait for what is in them
                remove_placement_group(self._free_rooms.pop())
            self._listen([*self._under_way])
            self._report()
        return self.states

    def _report(self) -> None:
        self._show(self.states)

    def stop(self) -> None:
        """Wait at most `STOP_SECONDS` until training runs have saved; other jobs have nothing to save."""
        deadline = time.monotonic() + STOP_SECONDS
        with stopping():
            while (training := self._training()) and time.monotonic() < deadline:
                self._listen(training)
        for state in self._under_way.values():
            state.writer.close()

    def release(self) -> None:
        """End what is left of all jobs, and free their resources: where Ray is not shut down after them."""
        for room in (*self._free_rooms, *(state.room for state in self._under_way.values())):
            remove_placement_group(room)
        self._free_rooms.clear()
        self._under_way.clear()

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
        if not streams:
            return  # jobs that could not begin
        ready, _ = ray.wait([*streams], num_returns=1, timeout=1.0)
        for stream in ready:
            with _uninterrupted():
                if not self._receive(self._under_way[stream]):
                    del self._under_way[stream]

    def most_at_once(self) -> int:
        """Return how many runs Ray has room for now, or the limit that was given."""
        has, needs = ray.cluster_resources(), self._resources
        most = int(has.get("CPU", 1)) // needs.processes
        if share := needs.learner_gpus:
            most = min(most, learners_on(living_nodes(), share) // max(needs.learners, 1))
        return needs.parallel or max(1, most)

    def _begin(self, state: JobState) -> None:
        """Start a job from its last checkpoint."""
        state.attempts += 1
        try:
            check_room(self._resources, living_nodes())  # machines may have gone since the start
            state.writer = RunWriter(state.job, state.folder, self._loggers)
            checkpoint = state.writer.checkpoint()
            inputs = state.writer.inputs()
            state.iteration = int((state.folder.training_state() or {}).get("iteration", 0))
        except SmartsError as error:
            state.status, state.error = "failed", _words(error)
            return
        state.status, state.room = STARTING, self._room()
        task = _execute.options(
            num_cpus=1,
            num_gpus=0 if self._resources.learners else self._resources.learner_gpus,
            max_retries=0,
            num_returns="streaming",
            _generator_backpressure_num_objects=BACKLOG,
            scheduling_strategy=PlacementGroupSchedulingStrategy(
                state.room, placement_group_bundle_index=0, placement_group_capture_child_tasks=True
            ),
        )
        state.updates = task.remote(state.job, checkpoint, inputs)
        self._under_way[state.updates] = state

    def _room(self) -> Any:
        """Return the resources of one run: all of them at once, lest two runs wait for each other's rest."""
        return self._free_rooms.pop() if self._free_rooms else placement_group(self._resources.bundles)

    def _receive(self, state: JobState) -> bool:
        """Receive a message of a job and write what it says; return whether more will follow."""
        try:
            self._write(state, ray.get(next(state.updates)))
            return True
        except StopIteration:
            state.status = FINISHED
        except RayTaskError as error:
            state.status, state.error = "failed", _words(error.cause or error)
        except RayError as error:
            # The process was killed, by a user or for want of memory, or its machine is gone.
            if state.attempts < ATTEMPTS:
                self._waiting.appendleft(state)
                state.status = WAITING
            else:
                state.status, state.error = "failed", f"lost its process {ATTEMPTS} times: {_words(error)}"
        except SmartsError as error:  # of this machine's disk
            state.status, state.error = "failed", _words(error)
        state.writer.close()
        if state.status == FINISHED:
            self._free_rooms.append(state.room)
        else:
            remove_placement_group(state.room)  # and what is left of the job with it
        return False

    def _write(self, state: JobState, message: Any) -> None:
        state.heard = time.monotonic()
        progress = state.writer.take(message)
        if progress is not None:
            state.progress, state.status = progress, progress.phase
        if isinstance(message, Kept) and message.place == CHECKPOINT:
            state.attempts = 1


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Put off Ctrl-C and SIGTERM, lest a message be lost between Ray and the disk."""
    came: list[int] = []
    with handled(lambda number, frame: came.append(number), signal.SIGINT, signal.SIGTERM):
        yield
    if came:
        signal.raise_signal(came[0])


def _words(error: BaseException) -> str:
    kind = "" if isinstance(error, SmartsError) else f"{type(error).__name__}: "
    return shortened(f"{kind}{error}")


@ray.remote
def _execute(job: Job, checkpoint: Mapping[str, bytes], inputs: Mapping[str, bytes]) -> Iterator[Message]:
    """Run a job in a process of its own, on whatever machine; yield its results and its progress."""
    # Imported here, so that the driver's process loads neither torch nor the simulation.
    from benchmark.running.testing import play_scripted
    from benchmark.running.training import train_and_evaluate

    with scratch_folder() as folder:
        import_own(job.task_setting.imports)
        scratch = RunFolder(folder)
        if checkpoint:
            write_files(scratch.checkpoint, checkpoint)
        write_files(scratch.inputs, inputs)
        with named_own_code("the run's own code"):
            if isinstance(job, Run):
                yield from train_and_evaluate(job, scratch, is_stopping)
            else:
                yield from play_scripted(job, scratch)


PREFIX = "smarts-bench-run-"


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """Provide a folder for all temporary files of this process; it is removed at the end."""
    place, before = Path(tempfile.gettempdir()), tempfile.tempdir
    remove_left(place, PREFIX)
    folder, lock = make_locked(place, PREFIX)
    tempfile.tempdir = str(folder)
    try:
        yield folder
    finally:
        tempfile.tempdir = before
        shutil.rmtree(folder, ignore_errors=True)
        os.close(lock)
