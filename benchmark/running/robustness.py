"""Cross-play and robustness of an experiment's policies: checked as a whole, then played in turn."""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.experiment.conditions import AS_TRAINED, condition, conditions
from benchmark.experiment.models import EMPTY_ROADS, Evaluation, TestCondition
from benchmark.experiment.own_code import own_digests
from benchmark.experiment.runs import OWN_CODE, TEST, Run, TaskSetting
from benchmark.metrics import read_table, write_table
from benchmark.metrics.results import Frame
from benchmark.metrics.table import COUNTS
from benchmark.results.files import ResultsError, locked, read_versioned, write_versioned
from benchmark.results.reading import CONDITION, Results, RunResult, read_results
from benchmark.results.release import RATES
from benchmark.results.robustness import (
    PARTNER,
    PLAY,
    ROBUSTNESS,
    TABLE,
    Play,
    played_condition,
    reference_rows,
    trained_state,
)
from benchmark.results.run_folder import RunFolder, changes_since
from benchmark.results.versions import check_one_version
from benchmark.running.importing import named_own_code
from benchmark.running.machine import machine
from benchmark.running.played import scenario_digests
from benchmark.running.playing_together import (
    Agents,
    ObservationsOfBoth,
    ScriptedDriver,
    TrainedDriver,
    play_together,
)
from benchmark.running.policy import Policy, read_run
from benchmark.running.side_by_side import side_by_side
from benchmark.running.testing import EVALUATION_SEED, play_parts
from benchmark.scripted import SCRIPTED_POLICIES
from smarts.errors import SmartsError, UnknownNameError, nearest_names
from smarts.registry import file_name, import_own

EPISODES = 100
"""Number of episodes of each play, if the tests have as many."""


@dataclass(frozen=True)
class Given:
    """What is asked for."""

    episodes: int | None = None
    """Number of the tests' first episodes that each play has. None: `EPISODES`, or all if there are fewer."""
    seed: int | None = None
    """Training seed of the policies; None: the smallest."""
    tasks: tuple[str, ...] = ()
    """TASK/TRAFFIC; none: all with social vehicles."""
    algorithms: tuple[str, ...] = ()
    """None: all."""
    partners: tuple[str, ...] = ("gap_acceptance",)
    """Scripted policies."""
    conditions: tuple[str, ...] = tuple(conditions())
    imports: tuple[Path, ...] = ()
    """Files and folders of own code; none: those of the trainings."""


@dataclass(frozen=True)
class Policies:
    """The policies that are played in a task with one traffic, by the names of their folders."""

    root: Path
    """The experiment's results."""
    seed: int
    episodes: int
    runs: Mapping[str, Run]
    """Runs of trained policies."""
    trained: Mapping[str, Mapping[str, Any]]
    """How far each training is; see `trained_state`."""
    scripted: Mapping[str, str]
    """Names of scripted policies by label."""

    @property
    def played(self) -> tuple[TestCondition, ...]:
        """The condition of the test that is played; empty if the task gives it none."""
        test = self.setting.task.test
        found = played_condition([each.model_dump() for each in test], self.setting.traffic)
        return tuple(each for each in test if found and each.name == found["name"])

    @property
    def setting(self) -> TaskSetting:
        """How the policies were trained and tested, apart from the algorithm."""
        return next(iter(self.runs.values())).task_setting


def policies_of(root: Path, given: Given) -> list[Policies]:
    """Return the policies that are to be played, in each task.

    Args:
        root: The experiment's results.
        given: What is asked for.

    Raises:
        SmartsError: An algorithm, scripted policy, task or condition is unknown; a run is not finished, or
            has no checkpoint, or no greedy test of so many episodes; runs are of several versions; what they
            were made of has changed.
    """
    import_own(given.imports)
    for name in given.conditions:
        condition(name)
    for name in given.partners:
        SCRIPTED_POLICIES[name]
    results = read_results(root)
    check_one_version(results.runs, str(root))
    learned = [run for run in results.runs if not run.is_scripted]
    known = {f"{run.task}/{run.traffic}": (run.task, run.traffic) for run in learned}
    _check_named("task", given.tasks, known)
    _check_named("algorithm", given.algorithms, {run.algorithm for run in learned})
    wanted = given.tasks or [name for name, (_, traffic) in known.items() if traffic != EMPTY_ROADS]
    if not wanted:
        raise ResultsError(
            "no trained policy was tested with social vehicles",
            place=str(root),
            remedy=f"name tasks with --task: {', '.join(known) or 'there is none'}",
        )
    seed = min(run.seed for run in learned) if given.seed is None else given.seed
    return [_policies(results, *known[name], seed, given) for name in wanted]


def _check_named(kind: str, names: Iterable[str], there: Collection[str]) -> None:
    """Raise if the results have no task or algorithm of a name."""
    for name in names:
        if name not in there:
            problem = f"there is no {kind} {name!r} in these results"
            raise UnknownNameError(problem, place=f"--{kind}", remedy=nearest_names(name, there))


def _policies(results: Results, task: str, traffic: str, seed: int, given: Given) -> Policies:
    """Return the policies of a task, checked."""
    where = f"{task}/{traffic}, seed {seed}"
    found = {
        run.algorithm: run
        for run in results.runs
        if (run.task, run.traffic, run.seed) == (task, traffic, seed)
        and (not given.algorithms or run.algorithm in given.algorithms)
    }
    tested = min((_tested(results, run) for run in found.values() if run.table is not None), default=0)
    episodes = given.episodes or min(EPISODES, tested)
    problem, remedy = _lack(found, episodes, tested)
    runs = {} if problem else {name: _read(results.root, run, given) for name, run in found.items()}
    if runs:
        problem, remedy = _hindrance(next(iter(runs.values())).task_setting, given.partners)
    if problem:
        raise ResultsError(problem, place=where, remedy=remedy)
    trained = {name: trained_state(run) for name, run in found.items()}
    scripted = {file_name(name): name for name in given.partners}
    return Policies(results.root, seed, episodes, runs, trained, scripted)


def _lack(found: Mapping[str, RunResult], episodes: int, tested: int) -> tuple[str, str]:
    """Return what is missing of the runs to play so many episodes, and what to do; "" if nothing is."""
    lacking = [f"{run}: {run.status}" for run in found.values() if run.table is None]
    if lacking or not found:
        problem = f"not finished: {'; '.join(lacking)}" if lacking else "there is no trained policy"
        return problem, "finish them, or choose others with --algorithm, --task and --seed"
    if not 0 < episodes <= tested:
        problem = (
            f"{episodes} episodes, and the tests have {tested} greedy ones, with which plays are compared"
        )
        return problem, "give fewer --episodes, or test with evaluation.modes: [greedy]"
    return "", ""


def _tested(results: Results, run: RunResult) -> int:
    """Return the number of greedy episodes of a test with which plays are compared."""
    rows = reference_rows(results, run.task, run.traffic, run.algorithm, run.seed)
    return 0 if rows is None else int(rows.loc[~rows["is_invalid"], "world"].nunique())


def _read(root: Path, run: RunResult, given: Given) -> Run:
    """Return a run as it was configured, after a check that nothing of it has changed.

    Raises:
        ResultsError: It has no checkpoint, or a scenario or own code has changed.
    """
    folder = RunFolder(root / run.place)
    folder.kept("last")
    found = read_run(folder, given.imports)
    if changed := changes_since(folder, found.content(), scenario_digests(found.task_setting)):
        raise ResultsError(
            f"changed since this run: {', '.join(changed)}",
            place=str(folder.path),
            remedy="restore it, or train again: plays are compared with the run's test",
        )
    return found


def _hindrance(setting: TaskSetting, partners: Sequence[str]) -> tuple[str, str]:
    """Return why there are no agents of two policies, which act alike, and what to do; "" if there are."""
    given = setting.environment
    if given.agent_count < 2 or given.learn_in_bubbles:
        problem = "agents learn in bubbles" if given.learn_in_bubbles else "there is one agent"
        return f"{problem}, and cross-play is of two or more with missions", "choose another --task"
    # One's own policies and adapters know of each other.
    ours = [x for x in partners if SCRIPTED_POLICIES[x].__module__.startswith("benchmark.scripted.")]
    actions = {each.action for each in given.driving().values()}
    if ours and given.adapter is None and actions != {"Lane"}:
        problem = f"{', '.join(ours)} act by lane actions, the policies by {', '.join(sorted(actions))}"
        return problem, "choose another --partner, or --partner none"
    return "", ""


def play_robustness(root: Path, given: Given, parallel: int | None = 1) -> Iterator[str]:
    """Play all pairs of policies and all conditions that are not there yet.

    Args:
        root: The experiment's results.
        given: What is asked for.
        parallel: Plays at a time, see `side_by_side`.

    Yields:
        A line for each play, when it is there.

    Raises:
        SmartsError: Something of it cannot be played; raised before anything is.
    """
    plays = [(each, play) for each in policies_of(root, given) for play in plays_of(each, given)]
    with locked(root / ROBUSTNESS):
        facts = machine()
        missing, count = [], 0
        for policies, play in plays:
            wanted = _wanted(policies, play)
            if _is_there(root / play.folder, {**wanted, "commit": facts["commit"]}):
                count += 1
                yield f"{count}/{len(plays)} {play}: was there"
            else:
                missing.append((policies, play, {**wanted, **facts}))
        for number, _ in side_by_side(_play, missing, parallel):
            count += 1
            yield f"{count}/{len(plays)} {missing[number][1]}"


def plays_of(policies: Policies, given: Given) -> Iterator[Play]:
    """Yield all pairs in both arrangements, then every policy by itself under each condition."""
    place, names = (
        (policies.setting.task.name, policies.setting.traffic),
        [*policies.runs, *policies.scripted],
    )
    for one, other in itertools.combinations(names, 2):
        if one in policies.runs:  # trained ones are first: tests of scripted policies alone say nothing here
            yield Play(*place, AS_TRAINED, one, other, policies.seed)
            yield Play(*place, AS_TRAINED, other, one, policies.seed)
    for name in given.conditions:
        for policy in names:
            yield Play(*place, name, policy, policy, policies.seed)


def _wanted(policies: Policies, play: Play) -> dict[str, Any]:
    scripted = [policies.scripted[name] for name in play.drivers if name in policies.scripted]
    return {
        **asdict(play),
        "episodes": policies.episodes,
        "environment": {} if play.condition == AS_TRAINED else condition(play.condition).environment,
        "trained": {name: policies.trained[name] for name in play.drivers if name in policies.trained},
        **({TEST: [each.model_dump(mode="json") for each in policies.played]} if policies.played else {}),
        OWN_CODE: own_digests(policies.setting.imports, scripted),
    }


def _is_there(folder: Path, wanted: Mapping[str, Any]) -> bool:
    """Return whether a play is there, as long or longer, with its rows, by the same code and checkpoints."""
    with suppress(SmartsError):
        found = read_versioned(folder / PLAY)
        is_same = {**wanted, "episodes": found["episodes"]}.items() <= found.items()
        return is_same and found["episodes"] >= wanted["episodes"] and len(read_table(folder / TABLE)) > 0
    return False


def _play(policies: Policies, play: Play, facts: Mapping[str, Any]) -> None:
    """Play and measure the episodes, and write rows, then facts, without which a play does not count."""
    import_own(policies.setting.imports)  # this may be a process of its own
    folder = policies.root / play.folder
    (folder / PLAY).unlink(missing_ok=True)
    trained = {name: _policy(policies, name) for name in play.drivers if name in policies.runs}
    setting = _setting(policies, play)

    def together(env: Any, indices: range, _: str) -> None:
        play_together(env, _drivers(env, play, policies, trained), indices)

    options = {"policy": "+".join(play.drivers), **_observations(policies, play)}
    options["discount"] = next((policy.discount for policy in trained.values()), None)
    labels = {"algorithm": "", "training_seed": policies.seed}
    with (
        tempfile.TemporaryDirectory(prefix="smarts-bench-") as scratch,
        named_own_code(f"a policy of {play}"),
    ):
        for _ in play_parts(setting, RunFolder(Path(scratch)), ("greedy",), labels, together, **options):
            pass
        table = read_table(RunFolder(Path(scratch)).table)
    write_table(_by_driver(table, play, _at_even_places(setting)), folder / TABLE)
    needing = [name for name, policy in trained.items() if policy.needs_others]
    write_versioned(folder / PLAY, {**facts, "needs_others": needing})


def _policy(policies: Policies, name: str) -> Policy:
    run = policies.runs[name]
    checkpoint = RunFolder(policies.root / run.folder).kept("last")
    return Policy(run, checkpoint, is_sampled=False, seed=EVALUATION_SEED)


def _setting(policies: Policies, play: Play) -> TaskSetting:
    """Return how a play is simulated and measured."""
    given = policies.setting.environment
    return replace(
        policies.setting,
        task=policies.setting.task.model_copy(update={TEST: policies.played}),
        environment=given if play.condition == AS_TRAINED else condition(play.condition).of(given),
        evaluation=Evaluation(episodes=policies.episodes, modes=("greedy",)),
        metrics=RATES,
    )


def _observations(policies: Policies, play: Play) -> dict[str, Any]:
    """Return arguments of an environment in which a scripted policy sees what it does in its own test."""
    scripted = [policies.scripted[name] for name in play.drivers if name in policies.scripted]
    wanted = getattr(SCRIPTED_POLICIES[scripted[0]], "observation", None) if scripted else None
    if wanted is None or policies.setting.environment.adapter is not None:
        return {}
    return {"adapter": ObservationsOfBoth, "adapter_options": {"scripted": wanted}}


def _drivers(
    env: Any, play: Play, policies: Policies, trained: Mapping[str, Policy]
) -> list[tuple[Any, Agents]]:
    """Return the drivers of an environment's agents, with the agents of each."""

    def driver(name: str, agents: Agents) -> tuple[Any, Agents]:
        if name in trained:
            return TrainedDriver(trained[name], agents, env), agents
        return ScriptedDriver(policies.scripted[name], agents, env), agents

    if play.even == play.odd:
        return [driver(play.even, np.ones(len(env.agents), np.bool_))]
    even = np.isin(env.agents, _at_even_places(policies.setting))
    return [driver(play.even, even), driver(play.odd, ~even)]


def _at_even_places(setting: TaskSetting) -> list[str]:
    """Return the agents at even places of the experiment: the first, the third, and so on."""
    return [*setting.environment.driving()][::2]


def _by_driver(table: Frame, play: Play, even: Sequence[str]) -> Frame:
    """Return the rows with the policies of the agent and of the others, and the condition."""
    is_even = table["agent"].isin([*even])
    drivers = np.where(is_even, play.even, play.odd)
    partners = np.where(is_even, play.odd, play.even)
    answer = table.assign(**{"algorithm": drivers, PARTNER: partners, CONDITION: play.condition})
    answer.attrs[COUNTS] = table.attrs[COUNTS]
    return answer
