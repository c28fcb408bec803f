"""What was asked of an experiment's folder: experiment.json and command.json, written and read."""

from __future__ import annotations

import json
from pathlib import Path

from pydantic import ValidationError

from benchmark.experiment.config import Experiment
from benchmark.results.files import LOST, ResultsError, first_line, read_mapping, write_json
from smarts.config import ConfigError, fitted
from smarts.errors import shortened

EXPERIMENT = "experiment.json"
"""What was asked for last."""
COMMAND = "command.json"
"""The last command that made or went on with the experiment, and as `PARTS` each distinct one with its
experiment."""
REMEDY = "`run` writes it anew"
PARTS = "parts"
"""In command.json; files of earlier versions have none."""


def keep_command(root: Path, experiment: Experiment, line: str) -> None:
    """Write what is asked for, beside what was asked for before: a folder may be filled by parts."""
    file, kept = root / EXPERIMENT, root / COMMAND
    content = experiment.model_dump(mode="json", exclude_unset=True)
    before = read_mapping(kept) if kept.exists() else {PARTS: []}
    if PARTS not in before:  # of an earlier version
        before = {PARTS: [{**before, "experiment": read_mapping(file)}] if file.exists() else []}
    if not isinstance(before[PARTS], list):
        raise ResultsError(f"damaged: its {PARTS} are no list", place=str(kept), remedy=LOST)
    part = {"command": line, "experiment": content}
    parts = [*(each for each in before[PARTS] if each != part), part]
    write_json(file, content)
    write_json(kept, {"command": line, PARTS: parts})


def last_experiment(root: Path, problems: dict[str, str]) -> Experiment | None:
    """Return what was asked for last; where that is not known, None, and `problems` says why."""
    file = root / EXPERIMENT
    if not file.exists():
        problems[file.name] = "missing, so that runs which have not begun are not known"
        return None
    try:
        return fitted(read_mapping(file), Experiment)
    except ConfigError as error:
        reasons = "; ".join(str(problem) for problem in error.problems)
        problems[file.name] = f"not an experiment of this version: {shortened(reasons)}; {REMEDY}"
    except ResultsError as error:
        problems[file.name] = f"{error.problem}; {REMEDY}"
    return None


def earlier_commands(root: Path, problems: dict[str, str]) -> tuple[tuple[str, ...], list[Experiment]]:
    """Return all commands that filled a folder, the last one too, and what was asked for before the last."""
    file = root / COMMAND
    if not file.exists():
        return (), []
    try:
        content = read_mapping(file)
        parts = content.get(PARTS, [content])
        experiments = [Experiment.model_validate_json(json.dumps(each["experiment"])) for each in parts[:-1]]
        return tuple(dict.fromkeys(str(each["command"]) for each in parts)), experiments
    except (ResultsError, KeyError, TypeError, ValidationError) as error:
        problems[file.name] = error.problem if isinstance(error, ResultsError) else first_line(error)
        return (), []
