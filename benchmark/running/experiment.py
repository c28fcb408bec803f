"""A whole experiment: check, train, test."""

from __future__ import annotations

import signal
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

import ray

from algorithms.joint.spec import JointSpec
from benchmark.experiment.algorithm_settings import CONFIGS
from benchmark.experiment.config import Experiment
from benchmark.experiment.runs import Run, cells_of
from benchmark.results.commands import keep_command
from benchmark.results.files import ResultsError, locked, read_json
from benchmark.results.run_folder import ENDED_BY, FINISHED, RunFolder
from benchmark.running.cluster import start_ray
from benchmark.running.driver import Driver, JobState, jobs_of
from benchmark.running.exit_codes import FAILED, INTERRUPTED
from benchmark.running.live import LiveProgress
from benchmark.running.machine import command
from benchmark.running.played import held_out_of, scenario_digests
from smarts.registry import is_own_name
from smarts.sstudio.build import build_scenario


def interruptible(work: Callable[[], int], left: str) -> int:
    """Do something that Ctrl-C and SIGTERM may end, and then say what is left of it.

    Args:
        work: What to do.
        left: What to say; see `goes_on`.

    Returns:
        The exit code: that of the work, or `INTERRUPTED`.
    """
    try:
        with _stoppable():
            return work()
    except KeyboardInterrupt:
        return tell_interruption(left)


def run_experiment(experiment: Experiment, root: Path) -> int:
    """Do all that is left of an experiment; return the exit code.

    Raises:
        SmartsError: A scenario is wrong, or the folder cannot be used.
    """
    check_cells(experiment)
    scenarios = {str(cell): scenario_digests(cell) for cell in cells_of(experiment)}
    with locked(root):
        live = LiveProgress()
        driver = Driver(jobs_of(experiment), root, experiment.resources, live.show)
        check_scenarios(driver, root, scenarios)
        keep_command(root, experiment, command())
        if driver.is_done:
            return _tell(driver.states, root)
        is_callers = ray.is_initialized()
        try:
            start_ray(experiment.resources)
            with live:
                states = _run(driver)
        finally:
            if not is_callers:
                ray.shutdown()
        return _tell(states, root)


def _run(driver: Driver) -> list[JobState]:
    """Do all jobs; at Ctrl-C or SIGTERM let them save first, unless it is given once more."""
    try:
        return driver.run()
    except KeyboardInterrupt:
        print("stopping: runs save how far they are; once more ends them at once", file=sys.stderr)
        driver.stop()
        raise


def check_cells(experiment: Experiment) -> None:
    """Build all scenarios and see that they can be played as wanted.

    Raises:
        SmartsError: The first that cannot.
    """
    for cell in cells_of(experiment):
        for scenario in cell.task.scenarios:
            egos = cell.environment.agents
            build_scenario(scenario, egos=egos).with_traffic([cell.traffic]).episodes(egos)
        for _ in held_out_of(cell):
            pass  # built and read, rather than after hours of training
    _check_own_code(experiment)


def _check_own_code(experiment: Experiment) -> None:
    """Play a decision with an own adapter or reward, and see that the algorithms can act in its environment.

    Raises:
        OwnCodeError: It cannot be made, or raises.
        SpaceError: An algorithm does not handle the adapter's actions or observations.
    """
    given = experiment.environment
    own = [name for name in (given.adapter, given.options.get("reward")) if isinstance(name, str)]
    if not any(map(is_own_name, own)):
        return
    # Here, so that the driver's process loads the simulation for own code only.
    from benchmark.running.environments import try_environment

    spaces = try_environment(cells_of(experiment)[0])
    if is_own_name(given.adapter):
        for algorithm in experiment.algorithms:
            CONFIGS[algorithm]().check(JointSpec.build(spaces))


def check_scenarios(driver: Driver, root: Path, scenarios: Mapping[str, Mapping[str, str]]) -> None:
    """See that what is there and what is still to be done are of the same scenarios; if all is done, tell.

    Args:
        driver: Of the experiment.
        root: Of its results.
        scenarios: Cell -> name -> digest, as the scenarios are now.

    Raises:
        ResultsError: Results of two versions of a scenario would stand side by side.
    """
    for state in driver.states:
        folder = RunFolder(root / state.job.folder)
        for name in folder.changed_scenarios(scenarios[str(state.job.cell)]):
            problem = f"the scenario {name!r} has changed since this run"
            if not driver.is_done:
                raise ResultsError(
                    problem,
                    place=str(folder.path),
                    remedy="bring it back as it was, or give the experiment another name or --out",
                )
            print(f"note: {folder.path}: {problem}", file=sys.stderr)


def goes_on(root: Path) -> str:
    """Return what is left of an interrupted command that fills a folder of results."""
    return f"what is finished is in {root}, the same command goes on"


def tell_interruption(left: str) -> int:
    """Say what Ctrl-C or SIGTERM has left; return the exit code."""
    print(f"interrupted; {left}", file=sys.stderr)
    return INTERRUPTED


def _tell(states: Sequence[JobState], root: Path) -> int:
    failed = [state for state in states if state.status != FINISHED]
    for state in failed:
        print(f"error: {state.job}: {state.error}", file=sys.stderr)
    if failed:
        print(
            f"{len(failed)} of {len(states)} runs failed; the same command tries them again", file=sys.stderr
        )
    ended_by = Counter(filter(None, (_ending_budget(state, root) for state in states)))
    if ended_by:
        print(
            f"training ended by: {', '.join(f'{name} in {count} runs' for name, count in ended_by.items())}"
        )
    print(f"results: {root}")
    return FAILED if failed else 0


def _ending_budget(state: JobState, root: Path) -> str | None:
    """Return which of a run's budgets was used up first; None for what is not trained to its end."""
    if state.status != FINISHED or not isinstance(state.job, Run):
        return None
    return read_json(RunFolder(root / state.job.folder).run).get(ENDED_BY)


@contextmanager
def _stoppable() -> Iterator[None]:
    """Let SIGTERM end what Ctrl-C ends."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
