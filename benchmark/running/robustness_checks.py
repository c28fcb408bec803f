"""What cross-play and robustness are played with: checked by name before anything is computed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmark.experiment.conditions import condition, conditions
from benchmark.experiment.config import EMPTY_ROADS
from benchmark.experiment.runs import Run, TaskSetting
from benchmark.metrics.results import Frame
from benchmark.results.files import ResultsError
from benchmark.results.reading import Results, RunResult, read_results
from benchmark.results.run_folder import RunFolder, changed_code
from benchmark.results.versions import check_one_version
from benchmark.running.played import scenario_digests
from benchmark.running.trained_run import read_run
from benchmark.scripted import SCRIPTED_POLICIES
from smarts.errors import UnknownNameError, nearest_names
from smarts.registry import file_name, import_own

EPISODES = 100
"""Of each play, if the tests have as many."""


@dataclass(frozen=True)
class Given:
    """What is asked for."""

    episodes: int | None = None
    """Of each play: the first ones of the tests. None: `EPISODES`, or as many as the tests have."""
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
    """Of trained policies."""
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
    _check_environments(runs, where)
    setting = next(iter(trained.values())).task_setting
    _check_cross_play(setting, given.partners)
    scripted = {file_name(name): name for name in given.partners}
    return Cell(task, traffic, seed, given.episodes or min(EPISODES, episodes), runs, trained, scripted)


def _tested(run: RunResult) -> int:
    """Return the number of greedy episodes of a run's test.

    Raises:
        ResultsError: There are none.
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


def _check_environments(runs: Mapping[str, RunResult], where: str) -> None:
    """Raise unless all policies of a cell were trained to see and act alike."""
    (first, one), *others = runs.items()
    for name, other in others:
        here, there = one.config.get("environment") or {}, other.config.get("environment") or {}
        differing = sorted(key for key in {*here, *there} if here.get(key) != there.get(key))
        if differing:
            raise ResultsError(
                f"{first} and {name} were trained in different environments: {', '.join(differing)}",
                place=where,
                remedy="choose algorithms of one environment with --algorithm",
            )


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
