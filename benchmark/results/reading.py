"""What an experiment has left on disk: read whole, or named and left out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from benchmark.experiment.config import Experiment
from benchmark.experiment.runs import SCRIPTED_SEED, references_of, training_folder, trainings_of
from benchmark.metrics import METRICS, join_tables
from benchmark.metrics.results import Frame
from benchmark.metrics.table import COUNTS
from benchmark.results.commands import EXPERIMENT, earlier_commands, last_experiment
from benchmark.results.files import ResultsError, read_mapping
from benchmark.results.known import known_facts, known_progress
from benchmark.results.run_folder import FINISHED, SCENARIOS, RunFolder
from benchmark.results.run_tables import LABELS, Names, names_of, read_run_table
from smarts.errors import OwnCodeError, SmartsError
from smarts.registry import file_name, import_own, is_own_name

NOT_BEGUN, UNREADABLE = "not begun", "unreadable"
"""States of runs beside those in run.json."""
TESTED_ANEW = "the command that made it tests the run anew if its checkpoint is there"
"""What to do about a damaged table."""


@dataclass(frozen=True)
class RunResult:
    """One run, finished or not."""

    algorithm: str
    """Or policy, of a reference."""
    task: str
    traffic: str
    seed: int
    """`SCRIPTED_SEED` of a reference."""
    place: str
    """Its folder in the experiment's."""
    status: str
    """As in run.json, or `NOT_BEGUN` or `UNREADABLE`."""
    facts: Mapping[str, Any] = field(default_factory=dict)
    """Of run.json."""
    config: Mapping[str, Any] = field(default_factory=dict)
    progress: Frame | None = None
    is_progress_whole: bool = True
    """Whether its last line is where the training ended, or is so far."""
    table: Frame | None = None
    """Agent-episodes of the test; None unless it is finished."""

    @property
    def is_reference(self) -> bool:
        """Whether the policy is scripted."""
        return self.seed == SCRIPTED_SEED

    @property
    def scenarios(self) -> Mapping[str, str]:
        """Name -> digest of each scenario that it is of; empty where that is not recorded."""
        found = self.facts.get(SCENARIOS)
        return found if isinstance(found, dict) else {}

    def __str__(self) -> str:
        seed = "" if self.is_reference else f", seed {self.seed}"
        return f"{self.algorithm}, {self.task}, {self.traffic}{seed}"


@dataclass(frozen=True)
class Results:
    """All that is on disk of an experiment."""

    root: Path
    name: str
    description: str
    commands: tuple[str, ...]
    """That made it, each once."""
    runs: tuple[RunResult, ...]
    problems: Mapping[str, str]
    """File or folder -> why it was left out."""

    @cached_property
    def finished(self) -> tuple[RunResult, ...]:
        """Runs whose test is on disk."""
        return tuple(run for run in self.runs if run.table is not None)

    @property
    def unfinished(self) -> tuple[RunResult, ...]:
        """Runs that are missing from the tables."""
        return tuple(run for run in self.runs if run.table is None)

    @cached_property
    def table(self) -> Frame:
        """Agent-episodes of all finished runs; empty without any."""
        return join_tables([run.table for run in self.finished if run.table is not None] or [_no_rows()])

    @property
    def counts(self) -> dict[str, Any]:
        """How many episodes were measured, void, incomplete, and which are corrupted."""
        return dict(self.table.attrs[COUNTS])


def read_results(root: Path) -> Results:
    """Return what is on disk of an experiment.

    Raises:
        ResultsError: The folder is not there, or holds neither an experiment nor runs.
    """
    if not root.is_dir():
        raise ResultsError(
            "there is no such folder of results", place=str(root), remedy="give an experiment's, results/NAME"
        )
    problems: dict[str, str] = {}
    experiment = last_experiment(root, problems)
    commands, parts = earlier_commands(root, problems)
    every = [*parts, experiment] if experiment else parts
    for each in every:
        _load_metrics(each, problems)
    expected = {run.place: run for each in every for run in _expected(each)}
    found = {run.place: run for run in _found(root, problems)}
    if experiment is None and not found:
        raise ResultsError(
            "no results of an experiment" + _reasons(problems),
            place=str(root),
            remedy="give the folder that `smarts-bench run` names at its end",
        )
    runs = {**expected, **found}
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
    """Import an experiment's own metrics, so that they are listed; those that cannot be are named."""
    own = [name for name in experiment.metrics or () if is_own_name(name)]
    try:
        import_own(experiment.imports if own else ())
        for name in own:
            METRICS[name]
    except OwnCodeError as error:
        problems[f"metrics of {EXPERIMENT}"] = f"{error.place}: {error.problem}; own metrics are left out"


def _expected(experiment: Experiment) -> Iterator[RunResult]:
    for algorithm, cell, seed in trainings_of(experiment):
        place = training_folder(algorithm, cell, seed).as_posix()
        yield RunResult(file_name(algorithm), cell.task.name, cell.traffic, seed, place, NOT_BEGUN)
    for each in references_of(experiment):
        cell = each.cell
        place = each.folder.as_posix()
        yield RunResult(each.label, cell.task.name, cell.traffic, SCRIPTED_SEED, place, NOT_BEGUN)


def _found(root: Path, problems: dict[str, str]) -> Iterator[RunResult]:
    """Yield the runs whose folders are there."""
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
        found = read_mapping(folder.run)
        config = _read_config(folder)
        lines = folder.read_progress()
    except ResultsError as error:
        problems[place] = f"{Path(error.place).name}: {error.problem}"
        return RunResult(*names, place, UNREADABLE)
    facts, bad = known_facts(found)
    status = str(facts.get("status", UNREADABLE))
    ending = {} if names[-1] == SCRIPTED_SEED or status != FINISHED else {**facts, **config}
    progress, said = known_progress(lines, ending)
    problems |= {
        f"{place}/{file.name}": text for file, text in ((folder.run, bad), (folder.progress, said)) if text
    }
    run = RunResult(*names, place, status, facts, config, progress, not said)
    if status != FINISHED:
        return run
    try:
        table = read_run_table(folder.table, names, facts.get("tested"))
    except SmartsError as error:
        problems[f"{place}/{folder.table.name}"] = f"{error.problem}; {TESTED_ANEW}"
        return replace(run, status=UNREADABLE)
    return replace(run, table=table)


def _read_config(folder: RunFolder) -> dict[str, Any]:
    config = folder.read_config()
    for name in ("environment", "budget", "settings"):
        if not isinstance(config.get(name, {}), dict):
            raise ResultsError(f"not a run's: its {name} is {config[name]!r}", place=str(folder.config))
    return config


def _no_rows() -> Frame:
    table = pd.DataFrame({name: [] for name in sorted(LABELS)})
    table.attrs[COUNTS] = {"measured": 0, "void": 0, "incomplete": 0, "corrupted": {}}
    return table
