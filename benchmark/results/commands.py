"""command.json of an experiment's folder: the commands that filled it, each with its experiment."""

from __future__ import annotations

from pathlib import Path

from benchmark.experiment.models import Experiment
from benchmark.experiment.values import KEPT
from benchmark.results.files import ResultsError, read_versioned, write_versioned
from smarts.config import ConfigError, fitted
from smarts.errors import shortened

COMMAND = "command.json"
"""The last command, and under `PARTS` all in their order with their experiments, repetitions left out."""
PARTS = "parts"
REMEDY = "remove it, and `run` writes it again"


def keep_command(root: Path, experiment: Experiment, line: str) -> None:
    """Write a command and its experiment, behind those of earlier commands."""
    kept = root / COMMAND
    content = experiment.model_dump(mode="json", exclude_unset=True)
    before = read_versioned(kept)[PARTS] if kept.exists() else []
    part = {"command": line, "experiment": content}
    write_versioned(kept, {"command": line, PARTS: before if before[-1:] == [part] else [*before, part]})


def read_commands(root: Path, problems: dict[str, str]) -> tuple[tuple[str, ...], list[Experiment | None]]:
    """Return the distinct commands that filled a folder, and their experiments; the last one is at the end.

    What is missing, damaged or of another version is left out, and goes into `problems`; an experiment that
    cannot be read is None.
    """
    file = root / COMMAND
    if not file.exists():
        problems[file.name] = "missing: runs that have not begun are not listed; `run` writes it again"
        return (), []
    try:
        parts = read_versioned(file)[PARTS]
    except ResultsError as error:
        problems[file.name] = f"{error.problem}; {REMEDY}"
        return (), []
    experiments: list[Experiment | None] = []
    for number, part in enumerate(parts, start=1):
        try:
            experiments.append(fitted(part["experiment"], Experiment, context=KEPT))
        except ConfigError as error:
            reasons = "; ".join(str(problem) for problem in error.problems)
            problem = f"not an experiment of this version: {shortened(reasons)}"
            problems[f"{file.name}, part {number}"] = f"{problem}; correct or remove that part"
            experiments.append(None)
    return tuple(dict.fromkeys(part["command"] for part in reversed(parts)))[::-1], experiments
