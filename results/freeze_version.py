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
from pathlib import Path
from typing import Any

import pandas as pd

from benchmark.experiment.config import read_experiment
from benchmark.experiment.models import Experiment
from benchmark.experiment.runs import runs_of
from benchmark.experiment.version import ALL, FILE, SETTINGS, TUNING, frozen_text, settings_digest
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
    FILE.write_text(text)
    print(f"wrote {FILE}")


if __name__ == "__main__":
    main()
