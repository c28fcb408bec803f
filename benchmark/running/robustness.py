"""Cross-play and robustness of an experiment's policies: checked as a whole, then played in turn."""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.experiment.conditions import AS_TRAINED, condition, conditions
from benchmark.experiment.config import EMPTY_ROADS, Evaluation
from benchmark.experiment.own_code import own_digests
from benchmark.experiment.runs import OWN_CODE, Run, TaskSetting
from benchmark.metrics import join_tables, write_table
from benchmark.metrics.results import Frame
from benchmark.metrics.table import COUNTS
from benchmark.results.files import ResultsError, locked, read_versioned, write_versioned
from benchmark.results.reading import Results, RunResult, read_results
from benchmark.results.release import RATES
from benchmark.results.robustness import (
    CONDITION,
    PARTNER,
    PLAY,
    ROBUSTNESS,
    TABLE,
    Play,
    read_play,
    trained_state,
)
from benchmark.results.run_folder import RunFolder, changed_code
from benchmark.results.versions import check_one_version
from benchmark.running.environments import environment
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
from benchmark.running.testing import EVALUATION_SEED, Part, measure_part
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
    cells: tuple[str, ...] = ()
    """TASK/TRAFFIC; none: all with social vehicles."""
    algorithms: tuple[str, ...] = ()
    """None: all."""
    partners: tuple[str, ...] = ("gap_acceptance",)
    """Scripted policies."""
    conditions: tuple[str, ...] = tuple(conditions())
    imports: tuple[Path, ...] = ()
    """Files and folders of own code; none: those of the trainings."""


@dataclass(frozen=True)
class Cell:
    """A task with one traffic, and the policies that are played in it, by the names of their folders."""

    task: str
    traffic: str
    seed: int
    episodes: int
    runs: Mapping[str, RunResult]
    """Runs of trained policies."""
    trained: Mapping[str, Run]
    """The same, as they were configured."""
    scripted: Mapping[str, str]
    """Names of scripted policies by label."""

    @property
    def names(self) -> tuple[str, ...]:
        """All policies, trained ones first."""
        return (*self.runs, *self.scripted)

    @property
    def setting(self) -> TaskSetting:
        """How the policies were trained and tested, apart from the algorithm."""
        return next(iter(self.trained.values())).task_setting


def cells_of(root: Path, given: Given) -> list[Cell]:
    """Return the cells that are to be played.

    Args:
        root: The experiment's results.
        given: What is asked for.

    Raises:
        SmartsError: An algorithm, scripted policy, cell or condition is unknown; a run is not finished, or
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
    places = _places(results, given)
    _check_known("algorithm", "--algorithm", given.algorithms, {run.algorithm for run in _learned(results)})
    seed = min(run.seed for run in _learned(results)) if given.seed is None else given.seed
    return [_cell(results, *place, seed, given) for place in places]


def _learned(results: Results) -> list[RunResult]:
    return [run for run in results.runs if not run.is_scripted]


def _places(results: Results, given: Given) -> list[tuple[str, str]]:
    """Return task and traffic of each cell that is asked for."""
    places = dict.fromkeys((run.task, run.traffic) for run in _learned(results))
    known = {f"{task}/{traffic}": (task, traffic) for task, traffic in places}
    _check_known("cell", "--cell", given.cells, known)
    wanted = given.cells or [name for name, (_, traffic) in known.items() if traffic != EMPTY_ROADS]
    if not wanted:
        raise ResultsError(
            "no trained policy was tested in a cell with social vehicles",
            place=str(results.root),
            remedy=f"name cells with --cell: {', '.join(known) or 'there is none'}",
        )
    return [known[name] for name in wanted]


def _check_known(kind: str, place: str, names: Any, known: Any) -> None:
    for name in names:
        if name not in known:
            problem = f"there is no {kind} {name!r} in these results"
            raise UnknownNameError(problem, place=place, remedy=nearest_names(name, known))


def _cell(results: Results, task: str, traffic: str, seed: int, given: Given) -> Cell:
    """Return a cell, checked."""
    where = f"{task}/{traffic}, seed {seed}"
    runs = {
        run.algorithm: run
        for run in _learned(results)
        if (run.task, run.traffic, run.seed) == (task, traffic, seed)
        and (not given.algorithms or run.algorithm in given.algorithms)
    }
    if not runs:
        seeds = sorted({run.seed for run in _learned(results)})
        raise ResultsError(
            "there is no trained policy", place=where, remedy=f"give another --seed: there is {seeds}"
        )
    if lacking := [f"{run}: {run.status}" for run in runs.values() if run.table is None]:
        raise ResultsError(
            f"not finished: {'; '.join(lacking)}",
            place=where,
            remedy="finish them, or choose others with --algorithm and --cell",
        )
    episodes = min(_tested(run) for run in runs.values())
    if given.episodes is not None and given.episodes > episodes:
        raise ResultsError(
            f"{given.episodes} episodes, and the tests have {episodes}: further ones could not be compared",
            place=where,
            remedy=f"give --episodes {episodes} or fewer",
        )
    trained = {name: _read(results.root, run, given) for name, run in runs.items()}
    setting = next(iter(trained.values())).task_setting
    _check_cross_play(setting, given.partners)
    scripted = {file_name(name): name for name in given.partners}
    return Cell(task, traffic, seed, given.episodes or min(EPISODES, episodes), runs, trained, scripted)


def _tested(run: RunResult) -> int:
    """Return the number of greedy episodes of a run's test.

    Raises:
        ResultsError: The test has no greedy episodes.
    """
    table: Frame = run.table
    rows = table[(table["mode"] == "greedy") & (table["split"] == "train") & ~table["is_invalid"]]
    if not len(rows):
        raise ResultsError(
            "no greedy test episodes, with which plays could be compared",
            place=str(run),
            remedy="test it with evaluation.modes: [greedy]",
        )
    return int(rows["world"].nunique())


def _read(root: Path, run: RunResult, given: Given) -> Run:
    """Return a run as it was configured, after a check that nothing of it has changed.

    Raises:
        ResultsError: It has no checkpoint, or a scenario or own code has changed.
    """
    folder = RunFolder(root / run.place)
    folder.kept("last")
    found = read_run(folder, given.imports)
    changed = [f"the code of {name!r}" for name in changed_code(folder.read_config(), found.content())]
    changed += [
        f"the scenario {name!r}" for name in folder.changed_scenarios(scenario_digests(found.task_setting))
    ]
    if changed:
        raise ResultsError(
            f"changed since this run: {', '.join(changed)}",
            place=str(folder.path),
            remedy="restore it, or train again: plays are compared with the run's test",
        )
    return found


def _check_cross_play(setting: TaskSetting, partners: Sequence[str]) -> None:
    """Raise unless there are agents of two policies, which act alike."""
    given = setting.environment
    if given.agent_count < 2 or given.learn_in_bubbles:
        problem = "agents learn in bubbles" if given.learn_in_bubbles else "there is one agent"
        raise ResultsError(
            f"{problem}, and cross-play is of two or more with missions",
            place=str(setting),
            remedy="choose another --cell",
        )
    # One's own policies and adapters know of each other.
    ours = [x for x in partners if SCRIPTED_POLICIES[x].__module__.startswith("benchmark.scripted.")]
    actions = {each.action for each in given.driving().values()}
    if ours and given.adapter is None and actions != {"Lane"}:
        raise ResultsError(
            f"{', '.join(ours)} act by lane actions, the policies by {', '.join(sorted(actions))}",
            place=str(setting),
            remedy="choose another --partner, or --partner none",
        )


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
    cells = cells_of(root, given)
    with locked(root / ROBUSTNESS):
        facts = machine()
        plays = [(cell, play) for cell in cells for play in plays_of(cell, given)]
        _keep_longer(root, plays)
        missing, there = [], 0
        for cell, play in plays:
            wanted = _wanted(cell, play)
            if _is_there(root / play.folder, {**wanted, "commit": facts["commit"]}):
                there += 1
                yield f"{there}/{len(plays)} {play}: was there"
            else:
                missing.append((root, cell, play, {**wanted, **facts}))
        for number, _ in side_by_side(_play, missing, parallel):
            there += 1
            yield f"{there}/{len(plays)} {missing[number][2]}"


def _keep_longer(root: Path, plays: Sequence[tuple[Cell, Play]]) -> None:
    """Raise if plays of more episodes would be replaced."""
    for cell, play in plays:
        file = root / play.folder / PLAY
        found = read_versioned(file)["episodes"] if file.exists() else 0
        if found > cell.episodes:
            raise ResultsError(
                f"a play of {found} episodes would be replaced by one of {cell.episodes}",
                place=str(file.parent),
                remedy=f"give --episodes {found}, or remove {root / ROBUSTNESS}",
            )


def plays_of(cell: Cell, given: Given) -> Iterator[Play]:
    """Yield all pairs in both arrangements, then every policy by itself under each condition."""
    place = cell.task, cell.traffic
    for one, other in itertools.combinations(cell.names, 2):
        if one in cell.runs or other in cell.runs:  # tests of scripted policies alone say nothing here
            yield Play(*place, AS_TRAINED, one, other, cell.seed)
            yield Play(*place, AS_TRAINED, other, one, cell.seed)
    for name in given.conditions:
        for policy in cell.names:
            yield Play(*place, name, policy, policy, cell.seed)


def _wanted(cell: Cell, play: Play) -> dict[str, Any]:
    return {
        **{"task": play.task, "traffic": play.traffic, "condition": play.condition},
        **{"even": play.even, "odd": play.odd, "episodes": cell.episodes, "training_seed": cell.seed},
        "environment": {} if play.condition == AS_TRAINED else condition(play.condition).environment,
        "trained": {name: trained_state(cell.runs[name]) for name in play.drivers if name in cell.runs},
        OWN_CODE: own_digests(
            cell.setting.imports, [cell.scripted[name] for name in play.drivers if name in cell.scripted]
        ),
    }


def _is_there(folder: Path, wanted: Mapping[str, Any]) -> bool:
    """Return whether a play is there, with its rows, by the same code and checkpoints."""
    with suppress(SmartsError):
        return wanted.items() <= read_versioned(folder / PLAY).items() and len(read_play(folder)) > 0
    return False


def _play(root: Path, cell: Cell, play: Play, facts: Mapping[str, Any]) -> None:
    """Play and measure the episodes, and write rows, then facts, without which a play does not count."""
    import_own(cell.setting.imports)  # this may be a process of its own
    (root / play.folder / PLAY).unlink(missing_ok=True)
    policies = {name: _policy(root, cell, name) for name in play.drivers if name in cell.runs}
    setting = _setting(cell, play)

    def play_part(part: Part, indices: range, record: Path) -> None:
        discount = next((policy.discount for policy in policies.values()), None)
        name = play.even if play.even == play.odd else f"{play.even}+{play.odd}"
        given = {"record": record, "discount": discount, "policy": name, **_observations(cell, play)}
        with closing(environment(setting, scenarios=part.scenarios, **given)) as env:
            play_together(env, _drivers(env, play, cell, policies), indices)

    doing = f"a policy of {play}"
    with tempfile.TemporaryDirectory(prefix="smarts-bench-") as scratch, named_own_code(doing):
        part = Part("greedy", setting.task.scenarios, cell.episodes)
        labels = {"algorithm": "", "training_seed": cell.seed, "task": play.task}
        labels |= {"task_traffic": play.traffic, "mode": "greedy", PARTNER: "", CONDITION: play.condition}
        table = join_tables([*measure_part(part, Path(scratch), labels, play_part, setting)])
    write_table(_by_driver(table, play, _at_even_places(setting)), root / play.folder / TABLE)
    needing = [name for name, policy in policies.items() if policy.needs_others]
    write_versioned(root / play.folder / PLAY, {**facts, "needs_others": needing})


def _policy(root: Path, cell: Cell, name: str) -> Policy:
    checkpoint = RunFolder(root / cell.runs[name].place).kept("last")
    return Policy(cell.trained[name], checkpoint, is_sampled=False, seed=EVALUATION_SEED)


def _setting(cell: Cell, play: Play) -> TaskSetting:
    """Return how a play is simulated and measured."""
    given = cell.setting.environment
    return replace(
        cell.setting,
        environment=given if play.condition == AS_TRAINED else condition(play.condition).of(given),
        evaluation=Evaluation(episodes=cell.episodes, modes=("greedy",)),
        metrics=RATES,
    )


def _observations(cell: Cell, play: Play) -> dict[str, Any]:
    """Return arguments of an environment in which a scripted policy sees what it does in its own test."""
    scripted = [cell.scripted[name] for name in play.drivers if name in cell.scripted]
    wanted = getattr(SCRIPTED_POLICIES[scripted[0]], "observation", None) if scripted else None
    if wanted is None or cell.setting.environment.adapter is not None:
        return {}
    return {"adapter": ObservationsOfBoth, "adapter_options": {"scripted": wanted}}


def _drivers(env: Any, play: Play, cell: Cell, policies: Mapping[str, Policy]) -> list[tuple[Any, Agents]]:
    """Return the drivers of an environment's agents, with the agents of each."""

    def driver(name: str, agents: Agents) -> tuple[Any, Agents]:
        if name in policies:
            return TrainedDriver(policies[name], agents, env), agents
        return ScriptedDriver(cell.scripted[name], agents, env), agents

    if play.even == play.odd:
        return [driver(play.even, np.ones(len(env.agents), np.bool_))]
    even = np.isin(env.agents, _at_even_places(cell.setting))
    return [driver(play.even, even), driver(play.odd, ~even)]


def _at_even_places(setting: TaskSetting) -> list[str]:
    """Return the agents at even places of the experiment: the first, the third, and so on."""
    return [*setting.environment.driving()][::2]


def _by_driver(table: Frame, play: Play, even: Sequence[str]) -> Frame:
    """Return the rows with each agent's policy as `algorithm`, and that of the other agents as `partner`."""
    is_even = table["agent"].isin([*even])
    drivers = np.where(is_even, play.even, play.odd)
    partners = np.where(is_even, play.odd, play.even)
    answer = table.assign(**{"algorithm": drivers, PARTNER: partners})
    answer.attrs[COUNTS] = table.attrs[COUNTS]
    return answer
