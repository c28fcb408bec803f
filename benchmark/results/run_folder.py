"""A run's folder: what is in it, and how a run that was interrupted goes on.

config.yaml      what the run depends on
run.json         status, versions, machine, times
progress.csv     a line for each iteration
tensorboard/     the same for TensorBoard
checkpoint/      the last one, with how far training was
best/            the one that did best in validation
episodes.parquet what the test measured: a row for each agent-episode
episodes/        the recorded test episodes, if they are kept
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from benchmark.experiment.runs import completed, is_larger
from benchmark.results.files import (
    ResultsError,
    first_line,
    named_failures,
    previous_of,
    read_json,
    read_mapping,
    recover_folder,
    replace_folder,
    write_json,
    write_whole,
)
from smarts.errors import SmartsError

ENDED_BY = "ended_by"
"""In run.json: the budget that was used up first, "agent_steps" or "minutes"."""
CONTINUED = "continued"
"""In run.json: what each continuation was made with, as the file itself says it of the beginning."""
SCENARIOS = "scenarios"
"""In run.json: name -> digest of each scenario that the run is of, as built; earlier versions have none."""
CONFIG_REMEDY = "bring it back from a copy, or remove the run's folder to start again"
BUDGET = "budget"
"""Key of a run's content in which it may grow."""
IMPORTS = "imports"
"""Key of a run's content that lists files and folders of own code."""
UNSET = "default"
"""What a value is shown as that is in one config only."""
FINISHED, TRAINING, TESTING = "finished", "training", "testing"
PROGRESS_COLUMNS: tuple[str, ...] = (
    "iteration",
    "agent_steps",
    "seconds",
    "agent_steps_per_second",
    "return",
    "completion",
    "collision",
    "validation_return",
    "validation_completion",
    "validation_collision",
)
"""Of progress.csv: means over the last episodes of training, and of the validation if there was one."""

PROGRESS_COUNTS = PROGRESS_COLUMNS[:3]
"""Those that are never empty: only finite numbers."""
_NEW_PROGRESS = "remove it: the run goes on from its checkpoint, and its curve begins there"


class RunFolder:
    """The results of one run on disk."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.config = path / "config.yaml"
        self.run = path / "run.json"
        self.progress = path / "progress.csv"
        self.tensorboard = path / "tensorboard"
        self.checkpoint = path / "checkpoint"
        self.best = path / "best"
        self.table = path / "episodes.parquet"
        self.episodes = path / "episodes"

    @property
    def status(self) -> str | None:
        """How far the run is; None if it has not begun."""
        return read_mapping(self.run).get("status") if self.run.exists() else None

    def is_finished(self, tested: Mapping[str, Any]) -> bool:
        """Whether there is nothing left to do: it is trained, tested in this way, and the test's table whole.

        Raises:
            ResultsError: The table is lost, damaged or of another test, and there is no checkpoint to test.
        """
        if self.status != FINISHED:
            return False
        before = read_mapping(self.run).get("tested")
        problem = "it was tested in another way" if before != dict(tested) else self._table_problem(tested)
        if problem and self.progress.exists() and not self.checkpoint.exists():
            raise ResultsError(
                f"{problem}; there is no checkpoint either that could be tested again",
                place=str(self.table),
                remedy=f"put it back, test as before ({before}), or give another --out to train anew",
            )
        return not problem

    def _table_problem(self, tested: Mapping[str, Any]) -> str:
        """Return why the test's table cannot be used, empty if it can."""
        # Here, so that a run that is not finished loads no metrics into the driver's process.
        from benchmark.results.run_tables import names_of, read_run_table

        if not self.table.exists():
            return "the test's table is missing"
        try:
            read_run_table(self.table, names_of(self.path.absolute()), tested)
        except SmartsError as error:
            return error.problem
        return ""

    def check(self, content: Mapping[str, Any]) -> None:
        """See that here is nothing, or a part of this run, perhaps with a smaller budget.

        Args:
            content: All that the run's training depends on.

        Raises:
            ResultsError: Here are the results of another run or of an unknown one, or they are damaged; or
                the budget is larger, and there is no checkpoint to train on from.
        """
        there, here = self._content(), completed(content)
        if there is None:
            return
        is_extended = _is_extended(here, there)
        compared = _with_common_imports(there, here), _with_common_imports(here, there)
        differing = _differing(*({**each, BUDGET: None} if is_extended else each for each in compared))
        if differing:
            raise ResultsError(
                f"here are results of a run with another config: {differing}",
                place=str(self.config),
                remedy="give the experiment another name or --out, or remove the folder to start again "
                "(with a larger budget and all else as it is, the run trains on)",
            )
        if is_extended and self.status in (TESTING, FINISHED) and not self._is_there(self.checkpoint):
            raise ResultsError(
                f"there is no checkpoint to train on from with a larger budget: {_differing(there, here)}",
                place=str(self.checkpoint),
                remedy="bring it back from a copy, or give the experiment another name or --out",
            )

    def is_extended(self, content: Mapping[str, Any]) -> bool:
        """Return whether this run is here with a smaller budget."""
        there = self._content()
        return there is not None and _is_extended(completed(content), there)

    def changed_scenarios(self, digests: Mapping[str, str]) -> list[str]:
        """Return the scenarios that were something else to this run; what it has not recorded is left out.

        Args:
            digests: Name -> digest of each, as they are now.
        """
        known = read_mapping(self.run).get(SCENARIOS, {}) if self.run.exists() else {}
        return [name for name, digest in digests.items() if known.get(name, digest) != digest]

    def _content(self) -> dict[str, Any] | None:
        """Return the config that what is here was made with, completed; None if here is nothing."""
        # A checkpoint without a run.json: it was damaged, and the user removed it.
        is_begun = bool(read_mapping(self.run)) if self.run.exists() else self._is_there(self.checkpoint)
        return completed(self.read_config()) if is_begun else None

    @staticmethod
    def _is_there(folder: Path) -> bool:
        """Return whether a folder is there, or can be recovered."""
        return folder.exists() or previous_of(folder).exists()

    def read_config(self) -> dict[str, Any]:
        """Return the content of config.yaml.

        Raises:
            ResultsError: It is missing or damaged.
        """
        try:
            content: Any = yaml.safe_load(self.config.read_text(encoding="utf-8"))
        except (OSError, ValueError, yaml.YAMLError) as error:
            problem = f"cannot be read: {first_line(error)}"
            raise ResultsError(problem, place=str(self.config), remedy=CONFIG_REMEDY) from error
        if not isinstance(content, dict):
            raise ResultsError("holds no keys and values", place=str(self.config), remedy=CONFIG_REMEDY)
        return content

    def open(self, content: Mapping[str, Any]) -> None:
        """Begin the run, or make sure that what is here is a part of it; see `check`."""
        self.check(content)
        with named_failures(self.path):
            self.path.mkdir(parents=True, exist_ok=True)
        if is_extended := self.is_extended(content):
            self.note(status=TRAINING)  # first: if killed in between, the run is not taken for finished
        # What is here without a run.json is of a run that was killed before it began, perhaps another one.
        is_known = self.run.exists() and self.read_config().get(IMPORTS) == content.get(IMPORTS)
        if is_extended or not is_known:
            text = yaml.safe_dump(dict(content), sort_keys=False)
            write_whole(self.config, lambda file: file.write_text(text, encoding="utf-8"))
        recover_folder(self.checkpoint)
        recover_folder(self.best)

    def note(self, **changes: Any) -> None:
        """Write into run.json."""
        before = read_mapping(self.run) if self.run.exists() else {}
        write_json(self.run, {**before, **changes})

    def note_continuation(self, circumstances: Mapping[str, Any]) -> None:
        """Write into run.json with what the run goes on after an interruption, or is tested anew."""
        before = read_mapping(self.run).get(CONTINUED, [])
        self.note(**{CONTINUED: [*(before if isinstance(before, list) else []), dict(circumstances)]})

    def save(self, folder: Path, algo: Any, state: Mapping[str, Any]) -> None:
        """Put a checkpoint into one of the two folders, with how far training is."""

        def fill(partial: Path) -> None:
            algo.save_to_path(str(partial.absolute()))
            write_json(partial / "training.json", dict(state))

        replace_folder(folder, fill)

    def training_state(self) -> dict[str, Any] | None:
        """Return how far training was at the last checkpoint, None without one.

        Raises:
            ResultsError: The checkpoint is damaged.
        """
        if not self.checkpoint.exists():
            return None
        return read_json(
            self.checkpoint / "training.json", remedy=f"remove the folder {self.checkpoint} to train anew"
        )

    def begin_progress(self, iteration: int) -> None:
        """Keep the lines of progress.csv up to an iteration, since those after it will be made again."""
        lines = [line for line in self.read_progress() if _iteration(line, self.progress) <= iteration]
        write_whole(self.progress, lambda file: _write_lines(file, lines))

    def add_progress(self, line: Mapping[str, Any]) -> None:
        """Add a line to progress.csv."""
        with named_failures(self.progress), self.progress.open("a", newline="", encoding="utf-8") as file:
            csv.DictWriter(file, PROGRESS_COLUMNS).writerow(line)

    def read_progress(self) -> list[dict[str, str]]:
        """Return the lines of progress.csv; one that a kill cut short is left out.

        Raises:
            ResultsError: It cannot be read, or is no table of progress.
        """
        if not self.progress.exists():
            return []
        try:
            with self.progress.open(newline="", encoding="utf-8") as file:
                reader = csv.DictReader(file)
                lines = [line for line in reader if None not in line and None not in line.values()]
                titles = set(reader.fieldnames or ())
        except (OSError, UnicodeDecodeError, csv.Error) as error:
            raise ResultsError(
                f"cannot be read: {first_line(error)}", place=str(self.progress), remedy=_NEW_PROGRESS
            ) from error
        if set(PROGRESS_COLUMNS) - titles:
            raise ResultsError("not a table of progress", place=str(self.progress), remedy=_NEW_PROGRESS)
        return lines


def progress_problem(line: Mapping[str, str]) -> str:
    """Return what is wrong with the numbers of a line of progress.csv, empty if nothing is."""
    for name in PROGRESS_COLUMNS:
        value = line[name]
        try:
            is_known = math.isfinite(float(value or "nan"))
        except ValueError:
            return f"{name} is {value!r}"
        if name in PROGRESS_COUNTS and not is_known:
            return f"{name} is {value!r}"
    return ""


def _iteration(line: Mapping[str, str], place: Path) -> int:
    """Return the iteration of a line of progress.csv, all of whose numbers are looked at."""
    problem = progress_problem(line)
    if problem:
        raise ResultsError(f"damaged: {problem}", place=str(place), remedy=_NEW_PROGRESS)
    return int(float(line["iteration"]))


def _write_lines(file: Path, lines: Sequence[Mapping[str, Any]]) -> None:
    with file.open("w", newline="", encoding="utf-8") as out:
        writer = csv.DictWriter(out, PROGRESS_COLUMNS)
        writer.writeheader()
        writer.writerows(lines)


def _is_extended(here: Mapping[str, Any], there: Mapping[str, Any]) -> bool:
    """Return whether the budget of a completed content is larger than another's, if both have one."""
    budgets = [each.get(BUDGET) for each in (here, there)]
    return all(isinstance(budget, dict) for budget in budgets) and is_larger(*budgets)  # type: ignore[arg-type]


def _with_common_imports(content: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, Any]:
    """Return a content with only those imports whose modules another one imports too, from wherever.

    A metric or an algorithm that is added to an experiment changes nothing in what its other runs trained.
    """
    modules = {Path(path).stem for path in other.get(IMPORTS) or ()}
    common = sorted(path for path in content.get(IMPORTS) or () if Path(path).stem in modules)
    return {**content, IMPORTS: common}


def _differing(there: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    """Return in words which values differ, nothing if none does."""
    one, two = _flat(there), _flat(here)
    names = [name for name in {**one, **two} if one.get(name, UNSET) != two.get(name, UNSET)]
    return ", ".join(f"{name} ({one.get(name, UNSET)}, here {two.get(name, UNSET)})" for name in names)


def _flat(content: Mapping[str, Any], above: str = "") -> dict[str, Any]:
    """Return the values of sections under names like "budget.minutes"."""
    found: dict[str, Any] = {}
    for name, value in content.items():
        found |= _flat(value, f"{above}{name}.") if isinstance(value, dict) else {f"{above}{name}": value}
    return found
