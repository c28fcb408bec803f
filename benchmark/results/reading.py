"""What an experiment has left on disk: read whole, or named and left out."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from benchmark.experiment.config import Experiment
from benchmark.experiment.runs import REFERENCE, SCRIPTED_SEED, references_of, runs_of
from benchmark.metrics import join_tables, read_table
from benchmark.metrics.results import Frame
from benchmark.metrics.table import COUNTS, EPISODE_KEYS
from benchmark.results.commands import earlier_commands, last_experiment
from benchmark.results.files import ResultsError, first_line, read_mapping
from benchmark.results.run_folder import FINISHED, PROGRESS_COLUMNS, SCENARIOS, RunFolder
from smarts.errors import SmartsError

NOT_BEGUN, UNREADABLE = "not begun", "unreadable"
"""States of runs beside those in run.json."""
LABELS = {
    *("algorithm", "training_seed", "task", "task_traffic", "mode", "split", "is_void", "agents"),
    *EPISODE_KEYS,
    *("start_x", "start_y", "start_heading", "start_speed"),
}
"""Columns without which a table is of something else."""


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


def _expected(experiment: Experiment) -> Iterator[RunResult]:
    for run in runs_of(experiment):
        cell = run.cell
        yield RunResult(
            run.algorithm, cell.task.name, cell.traffic, run.seed, run.folder.as_posix(), NOT_BEGUN
        )
    for each in references_of(experiment):
        cell = each.cell
        place = each.folder.as_posix()
        yield RunResult(each.policy, cell.task.name, cell.traffic, SCRIPTED_SEED, place, NOT_BEGUN)


def _found(root: Path, problems: dict[str, str]) -> Iterator[RunResult]:
    """Yield the runs whose folders are there."""
    for path in sorted(root.glob("*/*/*/*")):
        place = path.relative_to(root)
        kind, second, third, last = place.parts
        if kind.startswith(".") or not path.is_dir():
            continue
        if kind == REFERENCE:
            names = second, third, last, SCRIPTED_SEED
        elif last.startswith("seed_") and last[5:].isdecimal():
            names = kind, second, third, int(last[5:])
        else:
            continue
        run = _read_run(path, place.as_posix(), names, problems)
        if run is not None:
            yield run


def _read_run(
    path: Path, place: str, names: tuple[str, str, str, int], problems: dict[str, str]
) -> RunResult | None:
    folder = RunFolder(path)
    if not folder.run.exists():
        problems[place] = "not a run: it has no run.json"
        return None
    try:
        facts = read_mapping(folder.run)
        config = folder.read_config()
        progress = _read_progress(folder)
    except ResultsError as error:
        problems[place] = str(Path(error.place).name) + f": {error.problem}"
        return RunResult(*names, place, UNREADABLE)
    status = str(facts.get("status", UNREADABLE))
    run = RunResult(*names, place, status, facts, config, progress)
    if status != FINISHED:
        return run
    try:
        table = _checked(read_table(folder.table), names)
        _check_extent(table, facts.get("tested"))
    except SmartsError as error:
        problems[f"{place}/{folder.table.name}"] = error.problem
        return RunResult(*names, place, UNREADABLE, facts, config, progress)
    return RunResult(*names, place, status, facts, config, progress, table)


def _read_progress(folder: RunFolder) -> Frame | None:
    try:
        lines = folder.read_progress()
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ResultsError(f"cannot be read: {first_line(error)}", place=str(folder.progress)) from error
    if not lines:
        return None
    frame = pd.DataFrame(lines)
    if set(PROGRESS_COLUMNS) - set(frame.columns):
        raise ResultsError("not a table of progress", place=str(folder.progress))
    return frame[list(PROGRESS_COLUMNS)].apply(pd.to_numeric, errors="coerce")


def _checked(table: Frame, names: tuple[str, str, str, int]) -> Frame:
    """Return a table if it is of the run in whose folder it lies.

    Raises:
        ResultsError: It is not.
    """
    absent = sorted(LABELS - set(table.columns))
    if absent:
        raise ResultsError(f"not a run's table: it has no column '{absent[0]}'")
    algorithm, task, traffic, seed = names
    wanted = {"algorithm": algorithm, "task": task, "task_traffic": traffic, "training_seed": seed}
    for column, value in wanted.items():
        others = [each for each in table[column].unique().tolist() if each != value]
        if others:
            raise ResultsError(f"of another run: its {column} is {others[0]!r}, not {value!r}")
    return table


def _check_extent(table: Frame, tested: Any) -> None:
    """See that a table is of the test that its run says was made; of what is not said nothing is known.

    Raises:
        ResultsError: It holds other ways of acting, or not that many episodes.
    """
    if not isinstance(tested, dict) or not isinstance(wanted := tested.get("episodes"), int):
        return
    counts = table.attrs[COUNTS]
    lost = counts["incomplete"] + len(counts["corrupted"])
    plain = table[table["split"] == "train"]
    learned = (table["training_seed"] != SCRIPTED_SEED).any()
    for mode in sorted({*plain["mode"], *(tested.get("modes", []) if learned else [])}):
        rows = plain[plain["mode"] == mode]
        found = rows["world"].nunique()
        void = rows.loc[rows["is_void"], "world"].nunique()
        if not found - void <= wanted <= found + lost:
            raise ResultsError(
                f"of another test: it holds {found} {mode} episodes, the run was tested on {wanted}"
            )


def _no_rows() -> Frame:
    table = pd.DataFrame({name: [] for name in sorted(LABELS)})
    table.attrs[COUNTS] = {"measured": 0, "void": 0, "incomplete": 0, "corrupted": {}}
    return table
