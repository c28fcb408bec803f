"""A whole experiment: check, train, test."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path

import ray

from algorithms.joint.spec import JointSpec
from benchmark.experiment.algorithm_settings import CONFIGS
from benchmark.experiment.config import check_whole, read_experiment
from benchmark.experiment.environment import Environment
from benchmark.experiment.models import Experiment, TrainingTask
from benchmark.experiment.own_code import own_names
from benchmark.experiment.runs import task_settings_of
from benchmark.experiment.version import changed_task, differences
from benchmark.results.commands import keep_command
from benchmark.results.files import ResultsError, locked
from benchmark.results.reading import Results, read_results
from benchmark.results.run_folder import FINISHED
from benchmark.running.cluster import start_ray
from benchmark.running.environments import DT, given_hosts
from benchmark.running.exit_codes import FAILED, INTERRUPTED
from benchmark.running.jobs import JobScheduler, JobState, jobs_of
from benchmark.running.live import LiveProgress, plan
from benchmark.running.machine import command, commit
from benchmark.running.played import build_played, held_out_of, scenario_digests, scenarios_by_traffic
from benchmark.running.shipping import shipped_code
from benchmark.running.signals import handled
from smarts.agents.hosting.options import hosts_of
from smarts.agents.social import bubble_learning, social_agents
from smarts.errors import SmartsError
from smarts.providers.native.demand import Built
from smarts.sim.schedule import Schedule
from smarts.sstudio.build import build_scenario
from smarts.sstudio.built import BuiltScenario
from smarts.sstudio.cache import file_hash
from smarts.types.agent_states import agent_names


def interruptible(work: Callable[[], int], left: str) -> int:
    """Run a function; at Ctrl-C or SIGTERM print what is left.

    Args:
        work: The function.
        left: What to print; see `resumable`.

    Returns:
        The exit code: the function's, or `INTERRUPTED`.
    """
    try:
        with handled(signal.default_int_handler, signal.SIGTERM):  # like Ctrl-C
            return work()
    except KeyboardInterrupt:
        return interrupted(left)


def run_experiment(experiment: Experiment, root: Path) -> int:
    """Run all jobs of an experiment that are not finished; return the exit code.

    Raises:
        SmartsError: A scenario is wrong, or the folder cannot be used.
    """
    check_task_settings(experiment)
    check_version(experiment)
    scenarios = {
        str(task_setting): scenario_digests(task_setting) for task_setting in task_settings_of(experiment)
    }
    with locked(root):
        live = LiveProgress()
        scheduler = JobScheduler(jobs_of(experiment), root, experiment.resources, experiment.log, live.show)
        check_scenarios(scheduler, scenarios)
        keep_command(root, experiment, command())
        if scheduler.is_done:
            return _summarize(scheduler.states, root)
        is_callers = ray.is_initialized()
        try:
            with shipped_code(experiment) as code:
                start_ray(experiment.resources, code)
            print(plan(scheduler.states, scheduler.most_at_once()), file=sys.stderr)
            with live:
                states = _run(scheduler)
        finally:
            if is_callers:
                scheduler.release()
            else:
                ray.shutdown()
        return _summarize(states, root)


def _run(scheduler: JobScheduler) -> list[JobState]:
    """Run all jobs; at the first Ctrl-C or SIGTERM wait until they have saved, at the second end at once."""
    try:
        return scheduler.run()
    except KeyboardInterrupt:
        # Said first: who ends this command may end Ray, too, which then ends this process.
        print(
            "stopping: saving checkpoints, from which the same command continues; "
            "press Ctrl-C again to stop at once",
            file=sys.stderr,
        )
        scheduler.stop()
        raise


def check_task_settings(experiment: Experiment) -> None:
    """Build all scenarios and check that they fit the experiment, and the engine that agents learn with.

    Raises:
        SmartsError: The first scenario that does not.
    """
    build_played(name for task in experiment.tasks for name in task.names)
    for task_setting in task_settings_of(experiment):
        egos, task = task_setting.environment.mission_count, task_setting.task
        trained = [(name, each) for name in task.trained_on for each in task.train_traffic or (None,)]
        others = [(name, None) for name in task.validated_on]
        others += [(name, each.traffic) for each in task.test for name in each.scenarios]
        scenarios = []
        for name, other in dict.fromkeys(trained + others):
            traffic = other or task_setting.traffic
            built = build_scenario(name, egos=egos).with_traffic([traffic])
            built.episodes(egos)
            scenarios.append(built)
            if task_setting.environment.training_traffic and (name, other) in trained:
                Built([built.roads()], DT).add(0, built.traffic_files(traffic))
        check_unseen(task)
        check_social(task_setting.environment, list({built.name: built for built in scenarios}.values()))
        for _ in held_out_of(task_setting):
            pass  # built now, not after hours of training
    _check_spaces(experiment)


def check_unseen(task: TrainingTask) -> None:
    """Raise if a map of tests or validations is in the training, or one of tests in validations, by any name.

    Conditions that are marked as `seen` may play all maps.

    Raises:
        SmartsError: The first such map; the error names both scenarios.
    """
    net_of = cache(_net_of)
    trained = {net_of(name): name for name in task.trained_on}
    known = {net_of(name): name for name in task.validated_on} | trained
    unseen = [(f"the test {each.name!r}", each.scenarios, known) for each in task.test if not each.seen]
    if task.validation:
        unseen.append(("the validation", tuple(task.validated_on), trained))
    for what, names, others in unseen:
        for name in names:
            if seen := others.get(net_of(name)):
                use = "training" if seen in task.trained_on else "validation"
                raise SmartsError(
                    f"{what} plays {name!r}, whose map is in {use} as {seen!r}",
                    place=f"task {task.name!r}",
                    remedy="leave it out of one of the two, or mark a test's condition by seen: true",
                )


def _net_of(scenario: str) -> str | None:
    """Return a digest of a scenario's compiled map."""
    return file_hash(build_scenario(scenario).net_file)


def check_version(experiment: Experiment) -> None:
    """Check that an experiment plays what its version of the benchmark froze.

    Raises:
        SmartsError: A task, a scenario, code or a setting of the environment differs, or the source tree has
            changes.
    """
    version = experiment.benchmark_version
    if version is None:
        return
    told = [changed_task(version, task.name, task.names, task.lists) for task in experiment.tasks]
    found = [each for each in told if each]
    found += differences(version, scenarios_by_traffic(experiment), experiment.environment)
    if str(commit()).endswith("+"):
        found.append("the source tree has changes that are not committed: commit or stash them")
    if found:
        raise SmartsError(
            f"differs from version {version}:" + "".join(f"\n  {line}" for line in found),
            place="benchmark_version",
            remedy="leave it out, or restore what the version froze",
        )


def check_social(environment: Environment, scenarios: Sequence[BuiltScenario]) -> None:
    """Raise unless social agents and bubbles fit the scenarios.

    Raises:
        SmartsError: There is no such agent, there are more agents than missions, or no bubble to learn in.
    """
    described = any(built.scenario.bubbles or built.scenario.social_agent_missions for built in scenarios)
    if not (described or environment.social_agents or environment.learn_in_bubbles or environment.hosts):
        return
    # Only experiments with social agents wait for the zoo.
    from smarts.env.casting import cast_of

    added = social_agents([each.model_dump() for each in environment.social_agents])
    learning = bubble_learning(environment.learn_in_bubbles, environment.episode_time)
    names, hosts = agent_names(environment.agent_count), hosts_of(given_hosts(environment.hosts))
    Schedule(scenarios, names, cast=cast_of(scenarios, added, learning, hosts))


def _check_spaces(experiment: Experiment) -> None:
    """Check that the algorithms fit the agents' spaces, where these depend on own code or differ.

    A short episode is played and measured for it, and some steps by own scripted policies.

    Raises:
        OwnCodeError: Own code cannot be made, or raises.
        SpaceError: An algorithm does not handle the actions or observations.
    """
    task_setting = task_settings_of(experiment)[0]
    is_mixed = isinstance(task_setting.environment.agents, dict)
    if own_names(experiment.scripted):
        from benchmark.running.trying import try_scripted

        try_scripted(task_setting, experiment.scripted)
    if not is_mixed and not own_names([task_setting.environment.model_dump(), task_setting.metrics]):
        return
    # Imported here, so that the driver's process loads the simulation only where it is played.
    from benchmark.running.trying import try_own_code

    spaces = try_own_code(task_setting)
    for algorithm in experiment.algorithms:
        config = CONFIGS[algorithm]().training(**experiment.settings_of(algorithm))
        config.check(JointSpec.build(spaces, config.sharing, set_width=config.set_width))


def check_scenarios(scheduler: JobScheduler, scenarios: Mapping[str, Mapping[str, str]]) -> None:
    """Check that finished and remaining runs are of the same scenarios; if all are finished, print a note.

    Args:
        scheduler: Scheduler of the experiment.
        scenarios: Task setting -> name -> present digest.

    Raises:
        ResultsError: Results of two versions of a scenario would be mixed.
    """
    for state in scheduler.states:
        folder = state.folder
        for name in folder.changed_scenarios(scenarios[str(state.job.task_setting)]):
            problem = f"the scenario {name!r} has changed since this run"
            if not scheduler.is_done:
                raise ResultsError(
                    problem,
                    place=str(folder.path),
                    remedy="restore the scenario, or give the experiment another name or --out",
                )
            print(f"note: {folder.path}: {problem}", file=sys.stderr)


def resumable(root: Path) -> str:
    """Return the message of an interrupted command that can be resumed."""
    return f"finished runs are in {root}; give the same command again to resume"


def interrupted(left: str) -> int:
    """Print what is left after Ctrl-C or SIGTERM; return the exit code."""
    print(f"interrupted; {left}", file=sys.stderr)
    return INTERRUPTED


def _summarize(states: Sequence[JobState], root: Path) -> int:
    failed = [state for state in states if state.status != FINISHED]
    for state in failed:
        print(f"error: {state.job}: {state.error}", file=sys.stderr)
    if failed:
        print(
            f"{len(failed)} of {len(states)} runs failed; give the same command again to retry",
            file=sys.stderr,
        )
    print(f"results: {root}")
    return FAILED if failed else 0


def run(experiment: Experiment | str | Path, out: str | Path = "results") -> Results:
    """Train and test an experiment, and return its results; what is finished already is not done again.

    Failed runs are printed to stderr and are among `Results.unfinished`. A script that calls this has to keep
    own code in files or packages of its own, which other processes can import.

    Args:
        experiment: What is to be run, or the file that says so; an experiment made in Python needs a name.
        out: Folder of all results; the experiment's own is in it.

    Raises:
        ConfigError: Lists all mistakes for which an experiment file would be refused.
        SmartsError: A scenario is wrong, or the folder cannot be used.
        KeyboardInterrupt: After Ctrl-C; the same call continues.
    """
    made = experiment if isinstance(experiment, Experiment) else read_experiment(Path(experiment))
    checked = check_whole(made)
    root = Path(out) / checked.name
    run_experiment(checked, root)
    return read_results(root)
