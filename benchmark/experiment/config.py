"""Experiment files: read and checked, as the models of `benchmark.experiment.models`."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from benchmark.experiment.checks import check_experiment
from benchmark.experiment.models import Experiment
from benchmark.experiment.values import NAME
from smarts.config import ConfigError, Fault, Problem, read_config, shown


def read_experiment(
    file: Path, overrides: Iterable[str] = (), imports: Iterable[str | Path] = ()
) -> Experiment:
    """Return an experiment file's content.

    Args:
        file: The file.
        overrides: Values that go before the file's, as in "budget.minutes=5".
        imports: Own Python files and folders, in addition to the file's.

    Raises:
        ConfigError: Lists all of its mistakes.
    """
    given = [str(Path(path).absolute()) for path in imports]

    def completed(experiment: Experiment) -> Experiment:
        found = dict.fromkeys([*_found_beside(experiment.imports, file), *given])
        changes = {"name": experiment.name or file.stem} | ({"imports": tuple(found)} if found else {})
        return experiment.model_copy(update=changes)

    def check(experiment: Experiment) -> Iterator[Fault]:
        if not experiment.name and not NAME.fullmatch(file.stem):
            remedy = "give the experiment another one: name: ..."
            yield Fault((), f"the file's name {file.stem!r} cannot name a folder", remedy)
        yield from check_experiment(completed(experiment))

    return completed(read_config(file, Experiment, tuple(overrides), check))


def check_whole(experiment: Experiment) -> Experiment:
    """Return an experiment made in Python, checked as a file would be, with absolute imports.

    Raises:
        ConfigError: Lists all of its mistakes.
    """
    imports = tuple(str(Path(path).absolute()) for path in experiment.imports)
    values = json.loads(experiment.model_dump_json(exclude_unset=True))  # as a file has it
    faults = [*check_experiment(Experiment.model_validate({**values, "imports": [*imports]}))]
    if not experiment.name:
        faults.insert(0, Fault(("name",), "is missing", "give the experiment one: name=..."))
    if faults:
        problems = [Problem("", f"{shown(fault.key)}: {fault.text}", fault.remedy) for fault in faults]
        raise ConfigError(problems)
    return experiment.model_copy(update={"imports": imports} if imports else {})


def _found_beside(imports: Iterable[str], file: Path) -> Iterator[str]:
    """Yield the absolute paths of a file's imports, relative to its folder, or else to the working one."""
    for path in imports:
        beside = file.absolute().parent / path
        yield os.path.normpath(beside if beside.exists() else Path(path).absolute())
