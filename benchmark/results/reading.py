"""The results of an experiment: finished and unfinished runs, and damaged files that are left out."""

from __future__ import annotations

import math
import operator
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from benchmark.experiment.config import Experiment
from benchmark.experiment.runs import SCRIPTED_SEED, scripted_runs_of, training_folder, trainings_of
from benchmark.metrics import METRICS, join_tables
from benchmark.metrics.results import Frame
from benchmark.metrics.table import COUNTS
from benchmark.results.commands import EXPERIMENT, earlier_commands, last_experiment
from benchmark.results.files import FormatError, ResultsError
from benchmark.results.progress import COLUMNS as PROGRESS_COLUMNS
from benchmark.results.progress import read_progress
from benchmark.results.run_folder import CONTINUED, ENDED_BY, FINISHED, SCENARIOS, RunFolder
from benchmark.results.run_tables import LABELS, Names, names_of, read_run_table
from smarts.errors import OwnCodeError, SmartsError
from smarts.registry import file_name, import_own, is_own_name

NOT_BEGUN, UNREADABLE = "not begun", "unreadable"
"""States of runs beside those in run.json."""
TESTED_AGAIN = "the same `run` command tests the run again if its checkpoint is there"
"""Remedy of a damaged table."""


@dataclass(frozen=True)
class RunResult:
    """One run, finished or not."""

    algorithm: str
    """Or scripted policy."""
    task: str
    traffic: str
    seed: int
    """`SCRIPTED_SEED` of a scripted policy."""
    place: str
    """Its folder, relative to the experiment's."""
    status: str
    """As in run.json, or `NOT_BEGUN` or `UNREADABLE`."""
    facts: Mapping[str, Any] = field(default_factory=dict)
    """Of run.json."""
    config: Mapping[str, Any] = field(default_factory=dict)
    progress: Frame | None = None
    is_progress_whole: bool = True
    """Whether its last line is the end of training, or the present of one that is under way."""
    table: Frame | None = None
    """Agent-episodes of the test; None unless finished."""

    @property
    def is_scripted(self) -> bool:
        """Whether the policy is scripted."""
        return self.seed == SCRIPTED_SEED

    @property
    def scenarios(self) -> Mapping[str, str]:
        """Name -> digest of each scenario; empty if not recorded."""
        found = self.facts.get(SCENARIOS)
        return found if isinstance(found, dict) else {}

    def __str__(self) -> str:
        seed = "" if self.is_scripted else f", seed {self.seed}"
        return f"{self.algorithm}, {self.task}, {self.traffic}{seed}"


@dataclass(frozen=True)
class Results:
    """The results of an experiment."""

    root: Path
    name: str
    description: str
    commands: tuple[str, ...]
    """Distinct commands that made the results."""
    runs: tuple[RunResult, ...]
    problems: Mapping[str, str]
    """File or folder -> why it was left out."""

    @cached_property
    def finished(self) -> tuple[RunResult, ...]:
        """Runs with a valid test."""
        return tuple(run for run in self.runs if run.table is not None)

    @property
    def unfinished(self) -> tuple[RunResult, ...]:
        """All other runs, which tables leave out."""
        return tuple(run for run in self.runs if run.table is None)

    @cached_property
    def table(self) -> Frame:
        """Agent-episodes of all finished runs; empty without any."""
        return join_tables([run.table for run in self.finished if run.table is not None] or [_no_rows()])

    @property
    def counts(self) -> dict[str, Any]:
        """How many episodes were measured, invalid, incomplete, and which are corrupted."""
        return dict(self.table.attrs[COUNTS])


def read_results(root: Path) -> Results:
    """Return the results in an experiment's folder.

    Raises:
        ResultsError: The folder does not exist, or holds neither an experiment nor runs.
        FormatError: The results are of another format.
    """
    if not root.is_dir():
        raise ResultsError(
            "there is no such folder of results", place=str(root), remedy="give an experiment's, results/NAME"
        )
    problems: dict[str, str] = {}
    experiment = last_experiment(root, problems)
    commands, parts = earlier_commands(root, problems)
    runs: dict[str, RunResult] = {}
    for each in [*parts, experiment] if experiment else parts:
        _load_metrics(each, problems)
        runs |= {run.place: run for run in _expected(each)}
    found = {run.place: run for run in _found(root, problems)}
    if experiment is None and not found:
        raise ResultsError(
            "no results of an experiment" + _reasons(problems),
            place=str(root),
            remedy="give the folder that `smarts-bench run` names at its end",
        )
    runs |= found
    return Results(
        root=root,
        name=experiment.name if experiment else root.resolve().name,
        description=experiment.description if experiment else "",
        commands=commands,
        runs=tuple(runs[place] for place in sorted(runs)),
        problems=problems,
    )


def _reasons(problems: Mapping[str, str]) -> str:
    return "".join(f"; {name}: {reason}" for name, reason in problems.items())


def _load_metrics(experiment: Experiment, problems: dict[str, str]) -> None:
    """Import an experiment's own metrics, so that `METRICS` lists them; failures go into `problems`."""
    own = [name for name in experiment.metrics or () if is_own_name(name)]
    try:
        import_own(experiment.imports if own else ())
        for name in own:
            METRICS[name]
    except OwnCodeError as error:
        problems[f"metrics of {EXPERIMENT}"] = f"{error.place}: {error.problem}; own metrics are left out"


def _expected(experiment: Experiment) -> Iterator[RunResult]:
    for algorithm, task_setting, seed in trainings_of(experiment):
        place = training_folder(algorithm, task_setting, seed).as_posix()
        yield RunResult(
            file_name(algorithm), task_setting.task.name, task_setting.traffic, seed, place, NOT_BEGUN
        )
    for each in scripted_runs_of(experiment):
        task_setting = each.task_setting
        place = each.folder.as_posix()
        yield RunResult(
            each.label, task_setting.task.name, task_setting.traffic, SCRIPTED_SEED, place, NOT_BEGUN
        )


def _found(root: Path, problems: dict[str, str]) -> Iterator[RunResult]:
    """Yield the runs with a folder."""
    for path in sorted(root.glob("*/*/*/*")):
        place = path.relative_to(root)
        names = names_of(place)
        if names is None or place.parts[0].startswith(".") or not path.is_dir():
            continue
        run = _read_run(path, place.as_posix(), names, problems)
        if run is not None:
            yield run


def _read_run(path: Path, place: str, names: Names, problems: dict[str, str]) -> RunResult | None:
    folder = RunFolder(path)
    if not folder.run.exists():
        problems[place] = "not a run: it has no run.json"
        return None
    try:
        facts, bad_facts = _known_facts(folder.facts())
        config = _read_config(folder)
        lines, bad_lines = read_progress(folder.progress)
    except FormatError:
        raise
    except ResultsError as error:
        problems[place] = f"{Path(error.place).name}: {error.problem}"
        return RunResult(*names, place, UNREADABLE)
    status = str(facts.get("status", UNREADABLE))
    said = "; ".join(f"left out: line {number}, {problem}" for number, problem in bad_lines.items())
    progress = _as_numbers(lines)
    if not said and names[-1] != SCRIPTED_SEED and status == FINISHED:
        said = _missing_end(progress, {**facts, **config})
    found = {f"{place}/{folder.run.name}": bad_facts, f"{place}/{folder.progress.name}": said}
    problems.update(filter(operator.itemgetter(1), found.items()))
    run = RunResult(*names, place, status, facts, config, progress, not said)
    if status != FINISHED:
        return run
    try:
        table = read_run_table(folder.table, names, facts.get("tested"))
    except SmartsError as error:
        problems[f"{place}/{folder.table.name}"] = f"{error.problem}; {TESTED_AGAIN}"
        return replace(run, status=UNREADABLE)
    return replace(run, table=table)


def _as_numbers(lines: Sequence[Mapping[str, str]]) -> Frame | None:
    """Return lines of progress.csv as a frame, None without one."""
    columns = [*PROGRESS_COLUMNS]
    return pd.DataFrame(lines)[columns].apply(pd.to_numeric, errors="coerce") if lines else None


def _known_facts(facts: Mapping[str, Any]) -> tuple[dict[str, Any], str]:
    """Return the content of a run.json without invalid values, and what they were."""
    valid = {
        "test_seconds": lambda value: isinstance(value, int | float) and math.isfinite(value),
        "tested": _is_test,
        CONTINUED: lambda value: isinstance(value, list) and all(isinstance(each, dict) for each in value),
    }
    bad = [name for name, is_valid in valid.items() if name in facts and not is_valid(facts[name])]
    said = "; ".join(f"left out: {name} is {facts[name]!r}" for name in bad)
    return {name: value for name, value in facts.items() if name not in bad}, said


def _is_test(value: Any) -> bool:
    if not isinstance(value, dict) or not isinstance(value.get("episodes"), int):
        return False
    modes = value.get("modes", [])
    return isinstance(modes, list) and all(isinstance(mode, str) for mode in modes)


def _missing_end(progress: Frame | None, ending: Mapping[str, Any]) -> str:
    """Return that the progress of a trained run ends before its budget does; "" if it does not.

    Args:
        progress: Of the run.
        ending: Content of run.json and config.yaml.
    """
    if progress is None:
        return "missing or empty, though the training is over: there is no learning curve"
    budget = ending.get("budget") or {}
    wanted, minutes = budget.get("agent_steps"), budget.get("minutes")
    last = progress.iloc[-1]
    steps = last["agent_steps"] / wanted if isinstance(wanted, int | float) and wanted else 1.0
    # Seconds are rounded in the file.
    time = (last["seconds"] + 0.01) / (60 * minutes) if isinstance(minutes, int | float) and minutes else 0.0
    share = {"agent_steps": steps, "minutes": time}.get(str(ending.get(ENDED_BY)), max(steps, time))
    if share >= 1:
        return ""
    return f"ends at {last['agent_steps']:,.0f} agent-steps, {share:.0%} of the budget that training used up"


def _read_config(folder: RunFolder) -> dict[str, Any]:
    config = folder.read_config()
    for name in ("environment", "budget", "settings"):
        if not isinstance(config.get(name, {}), dict):
            raise ResultsError(f"not a run's: its {name} is {config[name]!r}", place=str(folder.config))
    return config


def _no_rows() -> Frame:
    table = pd.DataFrame({name: [] for name in sorted(LABELS)})
    table.attrs[COUNTS] = {"measured": 0, "invalid": 0, "incomplete": 0, "corrupted": {}}
    return table
