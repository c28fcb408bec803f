"""Freeze what an experiment plays as a version of the benchmark.

    python results/freeze_version.py 1 configs/benchmark_v1.yaml --tuned results/tune_v1

Writes digests of its scenarios, of its tasks' lists, and of the code of observations, rewards and metrics,
its settings of the environment, the budgets and sharing of its trainings, digests of their settings, and
how many trials have found these into `benchmark/experiment/versions.yaml`. Runs with `benchmark_version: 1`
are refused while something differs, except for budgets and sharing, which tell protocols apart, and
settings and tuning, by which reports say how a run's settings were found. A version that is there is frozen
again with `--replace` only.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from benchmark.experiment import version
from benchmark.experiment.config import read_experiment
from benchmark.experiment.environment import Environment
from benchmark.experiment.models import Experiment
from benchmark.experiment.runs import runs_of
from benchmark.experiment.version import ALL, SETTINGS, TUNING, settings_digest
from benchmark.running.played import scenarios_by_traffic
from smarts.errors import SmartsError


def training_of(experiment: Experiment) -> dict[str, dict[str, Any]]:
    """Return the budgets of an experiment by cell, and how its algorithms share parameters and are set."""
    runs = [*runs_of(experiment)]
    sharing = {run.label: run.settings.get("sharing") for run in runs}
    most = Counter(sharing.values()).most_common(1)[0][0]
    budgets: dict[str, Any] = {}
    settings: dict[str, dict[str, str]] = {}
    for run in runs:
        content, cell = run.content(), run.task_setting.folder.as_posix()
        budgets[cell] = content["budget"]
        settings.setdefault(run.label, {})[cell] = settings_digest(content["settings"])
    return {
        "budget": budgets,
        "sharing": {ALL: most} | {name: each for name, each in sharing.items() if each != most},
        SETTINGS: settings,
    }


def tuning_of(sweep: Path) -> dict[str, Any]:
    """Return the folder of a sweep's results, and number and agent-steps of each algorithm's trials.

    Args:
        sweep: Results of `smarts-bench sweep`.

    Raises:
        SmartsError: There are none, or those of an algorithm differ by cell.
    """
    found: dict[str, dict[str, int]] = {}
    for file in sorted(sweep.glob("*/*/*/search.json")):
        search = json.loads(file.read_text())
        each = {
            "agent_steps": search["run"]["budget"]["agent_steps"],
            "trials": len(pd.read_csv(file.with_name("trials.csv"))),
        }
        algorithm = search["run"]["algorithm"]
        if (known := found.setdefault(algorithm, each)) != each:
            raise SmartsError(
                f"{algorithm} has {each} here, and {known} in another cell",
                place=str(file.parent),
                remedy="give a sweep whose cells are all finished, with as many trials in each",
            )
    if not found:
        raise SmartsError("holds no search", place=str(sweep), remedy="give the results of a sweep")
    return {"results": sweep.as_posix(), "algorithms": found}


def frozen_text(
    number: int,
    played: version.Played,
    environment: Environment,
    *,
    training: Mapping[str, Any] | None = None,
    tasks: Mapping[str, Mapping[str, Any]] = {},
    replaces: bool = False,
) -> str:
    """Return the content of versions.yaml with the present code, scenarios and settings as a version.

    Args:
        number: Version to freeze.
        played: Digests of what is played.
        environment: Its settings.
        training: "budget" by "task/traffic", "sharing" by algorithm, with that of most as `ALL`, `SETTINGS`,
            and if it is known, `TUNING`; without it, nothing of trainings is prescribed.
        tasks: Lists of the tasks that are more than one scenario, by their names.
        replaces: Whether the version may be there already.

    Raises:
        SmartsError: It is.
    """
    file = version.FILE
    known = (yaml.safe_load(file.read_text(encoding="utf-8")) if file.exists() else None) or {}
    if number in known and not replaces:
        raise SmartsError(
            f"version {number} is frozen already, and results may be of it",
            place=str(file),
            remedy=f"freeze version {max(known) + 1}, or give --replace if there are no results of it",
        )
    frozen: dict[str, Any] = {
        **version.code_digests(),
        version.SCENARIOS: {traffic: version.by_split(digests) for traffic, digests in played.items()},
        version.ENVIRONMENT: environment.content(),
    }
    if tasks:
        frozen[version.TASKS] = {name: settings_digest(lists) for name, lists in tasks.items()}
    if training is not None:
        frozen[version.TRAINING] = {part: dict(given) for part, given in training.items()}
    return yaml.safe_dump({**known, number: frozen})


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Freeze a version of the benchmark.")
    parser.add_argument("version", type=int)
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--tuned", type=Path, help="results of the sweep that found the settings")
    parser.add_argument(
        "--replace",
        action="store_true",
        help="overwrite a version that is there; results of it, if any, are then of another one "
        "(which is not checked)",
    )
    given = parser.parse_args()
    experiment = read_experiment(given.experiment)
    played, environment = scenarios_by_traffic(experiment), experiment.environment
    try:
        training = training_of(experiment)
        if given.tuned is not None:
            training[TUNING] = tuning_of(given.tuned)
        tasks = {each.name: each.lists for each in experiment.tasks if each.names != [each.name]}
        parts = {"training": training, "tasks": tasks}
        text = frozen_text(given.version, played, environment, **parts, replaces=given.replace)
    except SmartsError as error:
        parser.exit(1, f"error: {error}\n")
    version.FILE.write_text(text)
    print(f"wrote {version.FILE}")


if __name__ == "__main__":
    main()
