"""experiment.json and command.json of an experiment's folder: the experiment and the commands that ran it."""

from __future__ import annotations

import json
from pathlib import Path

from pydantic import ValidationError

from benchmark.experiment.config import Experiment
from benchmark.results.files import (
    LOST,
    FormatError,
    ResultsError,
    first_line,
    read_mapping,
    read_versioned,
    write_json,
    write_versioned,
)
from smarts.config import ConfigError, fitted
from smarts.errors import shortened

EXPERIMENT = "experiment.json"
"""The last experiment."""
COMMAND = "command.json"
"""The last command, and under `PARTS` each distinct command with its experiment."""
REMEDY = "`run` writes it again"
PARTS = "parts"


def keep_command(root: Path, experiment: Experiment, line: str) -> None:
    """Write experiment and command, beside those of earlier commands."""
    kept = root / COMMAND
    content = experiment.model_dump(mode="json", exclude_unset=True)
    before = read_versioned(kept).get(PARTS, []) if kept.exists() else []
    if not isinstance(before, list):
        raise ResultsError(f"damaged: its {PARTS} are not a list", place=str(kept), remedy=LOST)
    part = {"command": line, "experiment": content}
    write_json(root / EXPERIMENT, content)
    write_versioned(kept, {"command": line, PARTS: [*(each for each in before if each != part), part]})


def last_experiment(root: Path, problems: dict[str, str]) -> Experiment | None:
    """Return the last experiment; None, with the reason in `problems`, if its file is missing or damaged."""
    file = root / EXPERIMENT
    if not file.exists():
        problems[file.name] = "missing; runs that have not started cannot be listed"
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
    """Return all commands that filled a folder, and the experiments of all but the last.

    Raises:
        FormatError: The results are of another format.
    """
    file = root / COMMAND
    if not file.exists():
        return (), []
    try:
        parts = read_versioned(file)[PARTS]
        experiments = [Experiment.model_validate_json(json.dumps(each["experiment"])) for each in parts[:-1]]
        return tuple(dict.fromkeys(str(each["command"]) for each in parts)), experiments
    except FormatError:
        raise
    except (ResultsError, KeyError, TypeError, ValidationError) as error:
        problems[file.name] = error.problem if isinstance(error, ResultsError) else first_line(error)
        return (), []
