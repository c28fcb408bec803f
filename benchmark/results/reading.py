"""The results of an experiment: finished and unfinished runs, and damaged files that are left out.

Git keeps finished runs and plays in few files, which `results/pack.py` writes:

runs.json         place of a run -> contents of its run.json and config.yaml, counts of its episodes
progress.parquet  lines of all progress.csv
episodes.parquet  agent-episodes of all tests
robustness/       runs.json: place of a play -> content of its play.json; episodes.parquet
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from benchmark.experiment.models import Contrasts, Experiment
from benchmark.experiment.runs import (
    SCRIPTED,
    SCRIPTED_SEED,
    TEST,
    TESTED,
    VERSION,
    scripted_runs_of,
    training_folder,
    trainings_of,
)
from benchmark.metrics import METRICS, join_tables, read_table
from benchmark.metrics.results import Frame
from benchmark.metrics.table import COUNTS, EPISODE_KEYS, START
from benchmark.results.commands import COMMAND, read_commands
from benchmark.results.files import ResultsError, read_versioned
from benchmark.results.progress import read_progress
from benchmark.results.release import MANIFEST, VERDICTS
from benchmark.results.run_folder import FINISHED, SCENARIOS, TABLE, RunFolder
from smarts.errors import OwnCodeError, SmartsError
from smarts.registry import import_own, is_own_name

RUNS, PROGRESS = "runs.json", "progress.parquet"
PLACE = "place"
"""Column of the run's or play's folder, relative to the experiment's."""


def packed_contents(root: Path) -> dict[str, Any]:
    """Return place -> content of what is packed in a folder."""
    return read_versioned(root / RUNS) if (root / RUNS).exists() else {}


def run_folder(root: Path, place: Path, packed: Mapping[str, Any]) -> RunFolder:
    """Return a run's folder, or what is packed of it, if there is no folder.

    Args:
        root: Folder of the experiment.
        place: Place of the run.
        packed: Result of `packed_contents`.
    """
    folder = RunFolder(root / place)
    return folder if folder.run.exists() else RunFolder(folder.path, packed.get(place.as_posix()))


NOT_BEGUN, UNREADABLE = "not begun", "unreadable"
"""States of runs beside those in run.json."""
REPORT = "report"
"""Folder of the report, in an experiment's results."""
LABELS = {
    *("algorithm", "training_seed", "task", "task_traffic", "mode", "split", "agent", "is_invalid", "agents"),
    *EPISODE_KEYS,
    *START,
}
"""Columns that every table of a run has."""
CONDITION = "condition"
"""Column of tables of tests with several: name of the condition in the task's `test`; of plays
of `robustness`, that in `conditions.yaml`."""
MEETS = "meets"
"""Column of tables of tests: 1 for agents with a way that meets another agent's; see
`benchmark.running.meetings`. NaN without a way to a goal; older tables lack it."""
Names = tuple[str, str, str, int]
"""Names of a run: algorithm or policy, task, traffic, training seed."""
TESTED_AGAIN = "remove it, and the same `run` command tests the run again if its checkpoint is there"
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
    """Status of run.json, or `NOT_BEGUN` or `UNREADABLE`."""
    facts: Mapping[str, Any] = field(default_factory=dict)
    """Content of run.json."""
    config: Mapping[str, Any] = field(default_factory=dict)
    progress: Frame | None = None
    table: Frame | None = None
    """Agent-episodes of the test; None unless finished."""

    @property
    def is_scripted(self) -> bool:
        """Whether the policy is scripted."""
        return self.seed == SCRIPTED_SEED

    @property
    def scenarios(self) -> Mapping[str, str]:
        """Name -> digest of each scenario; empty if not recorded."""
        return self.facts.get(SCENARIOS, {})

    @property
    def test(self) -> Sequence[Mapping[str, Any]]:
        """Conditions that the task gave its test; empty without any."""
        return (self.facts.get(TESTED) or {}).get(TEST, ())

    @property
    def benchmark_version(self) -> int | None:
        """Version of the benchmark that it was made under; None for none."""
        return self.config.get(VERSION)

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
    contrasts: Contrasts | None = None
    """The contrasts of the first command that has any."""
    contrasted: tuple[tuple[str, str], ...] = ()
    """Tasks of that command with all conditions of its contrasts, with each traffic."""
    has_new_contrasts: bool = False
    """Whether an earlier command had none: then they were not fixed before training."""
    has_other_contrasts: bool = False
    """Whether a later command had others, or none."""

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


def holds_results(root: Path) -> bool:
    """Return whether a path is a folder of an experiment's results, or of an evaluated submission."""
    if any((root / name).exists() for name in (COMMAND, VERDICTS)):
        return True
    with suppress(OSError):  # of folders that vanish meanwhile
        return next(root.glob("*/*/*/seed_*/run.json"), None) is not None
    return False


def read_results(root: Path) -> Results:
    """Return the results in an experiment's folder.

    Raises:
        ResultsError: The folder does not exist, or holds neither an experiment nor runs.
    """
    if not root.is_dir():
        raise ResultsError(
            "there is no such folder of results", place=str(root), remedy="give an experiment's, results/NAME"
        )
    problems: dict[str, str] = {}
    commands, experiments = read_commands(root, problems)
    if has_verdicts := (root / VERDICTS).exists():  # of submissions, which no experiment has made
        problems.pop(COMMAND, None)
    runs: dict[str, RunResult] = {}
    last = experiments[-1] if experiments else None
    experiments = [each for each in experiments if each is not None]
    for each in experiments:
        _load_metrics(each, problems)
        runs |= {run.place: run for run in _expected(each)}
    found = {run.place: run for run in (*_packed(root), *_found(root, problems))}
    if not experiments and not found and not has_verdicts:
        raise _nothing_in(root, problems)
    runs |= found
    fixed = next((each for each in experiments if each.contrasts), None)
    later = experiments[experiments.index(fixed) :] if fixed else []
    return Results(
        root=root,
        name=last.name if last else root.resolve().name,
        description=last.description if last else "",
        commands=commands,
        runs=tuple(runs[place] for place in sorted(runs)),
        problems=problems,
        contrasts=fixed.contrasts if fixed else None,
        contrasted=tuple(_contrasted(fixed)) if fixed else (),
        has_new_contrasts=len(later) not in (0, len(experiments)),
        has_other_contrasts=any(each.contrasts != later[0].contrasts for each in later),
    )


def _contrasted(experiment: Experiment) -> Iterator[tuple[str, str]]:
    """Yield task and traffic of what an experiment's contrasts are about."""
    wanted = {*experiment.contrasts.conditions} if experiment.contrasts else set()
    for task in experiment.tasks:
        if wanted <= {each.name for each in task.test}:
            yield from ((task.name, traffic) for traffic in experiment.traffic)


def _nothing_in(root: Path, problems: Mapping[str, str]) -> ResultsError:
    """Return the error of a folder without results, with what is wrong with its files."""
    reasons = "".join(f"; {name}: {reason}" for name, reason in problems.items())
    remedy = "give the folder that `smarts-bench run` names at its end"
    if (root / MANIFEST).exists():
        remedy = "evaluate the release first: smarts-bench verify"
    return ResultsError(f"no results of an experiment{reasons}", place=str(root), remedy=remedy)


def _load_metrics(experiment: Experiment, problems: dict[str, str]) -> None:
    """Import an experiment's own metrics, so that `METRICS` lists them; failures go into `problems`."""
    own = [name for name in experiment.metrics or () if is_own_name(name)]
    try:
        import_own(experiment.imports if own else ())
        for name in own:
            METRICS[name]
    except OwnCodeError as error:
        problems[f"metrics of {COMMAND}"] = f"{error.place}: {error.problem}; own metrics are left out"


def _expected(experiment: Experiment) -> Iterator[RunResult]:
    places = [training_folder(*each) for each in trainings_of(experiment)]
    places += [each.folder for each in scripted_runs_of(experiment)]
    for place in places:
        if names := names_of(place):
            yield RunResult(*names, place.as_posix(), NOT_BEGUN)


def _packed(root: Path) -> Iterator[RunResult]:
    """Yield the runs that are packed, which were checked before."""
    tables, curves = packed_rows(root), packed_rows(root, PROGRESS)
    for place, content in packed_contents(root).items():
        if names := names_of(root.absolute() / place):
            table = tables[place]
            table.attrs[COUNTS] = content[COUNTS]
            facts, config = content["run"], content["config"]
            yield RunResult(*names, place, FINISHED, facts, config, curves.get(place), table=table)


def packed_rows(root: Path, name: str = TABLE) -> dict[str, Frame]:
    """Return place -> rows of a table that is packed in a folder."""
    if not (root / name).exists():
        return {}
    groups = pd.read_parquet(root / name).groupby(PLACE, sort=False)
    return {str(place): rows.drop(columns=PLACE).reset_index(drop=True) for place, rows in groups}


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
        facts, config = folder.facts(), folder.read_config()
    except ResultsError as error:
        problems[place] = f"{Path(error.place).name}: {error.problem}"
        return RunResult(*names, place, UNREADABLE)
    run = RunResult(*names, place, str(facts.get("status", UNREADABLE)), facts, config)
    try:
        progress = read_progress(folder.progress)
        run = replace(run, progress=progress if len(progress) else None)
    except ResultsError as error:
        problems[f"{place}/{folder.progress.name}"] = error.problem
    if run.status != FINISHED:
        return run
    try:
        table = read_table(folder.table)
    except SmartsError as error:
        problems[f"{place}/{folder.table.name}"] = f"{error.problem}; {TESTED_AGAIN}"
        return replace(run, status=UNREADABLE)
    labels = table[["algorithm", "task", "task_traffic", "training_seed"]]
    if others := {*labels.itertuples(index=False, name=None)} - {names}:
        problems[f"{place}/{folder.table.name}"] = f"of another run: {others.pop()}; {TESTED_AGAIN}"
        return replace(run, status=UNREADABLE)
    # Episodes of several runs may have one name.
    corrupted = {f"{place}: {name}": why for name, why in table.attrs[COUNTS]["corrupted"].items()}
    table.attrs[COUNTS] = {**table.attrs[COUNTS], "corrupted": corrupted}
    return replace(run, table=table)


def _no_rows() -> Frame:
    table = pd.DataFrame({name: [] for name in sorted(LABELS)})
    table.attrs[COUNTS] = {"measured": 0, "invalid": 0, "incomplete": 0, "corrupted": {}}
    return table


def played_in(table: Frame) -> Any:
    """Return the condition of each row of a test, or else its scenario with the variation."""
    marks = table["variation"].where(table["variation"] == "", "@" + table["variation"])
    played = table["scenario"].str.cat(marks)
    return table[CONDITION].fillna(played) if CONDITION in table else played


def names_of(folder: Path) -> Names | None:
    """Return the names of the run in a folder, by the end of its path; None if it is not a run's."""
    kind, second, third, last = folder.parts[-4:] if len(folder.parts) >= 4 else [""] * 4
    if kind == SCRIPTED:
        return second, third, last, SCRIPTED_SEED
    if last.startswith("seed_") and last[5:].isdecimal():
        return kind, second, third, int(last[5:])
    return None
