"""Freeze what an experiment plays as a version of the benchmark.

    python results/freeze_version.py 1 configs/benchmark_v1.yaml

Writes digests of its scenarios, and of the code of observations, rewards and metrics, its settings of the
environment, and the budgets and sharing of its trainings into `benchmark/experiment/versions.yaml`. Runs with
`benchmark_version: 1` are refused while something differs, except for budgets and sharing, which tell
protocols apart. A version that is there is frozen again with `--replace` only.
"""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path
from typing import Any

from benchmark.experiment.config import Experiment, read_experiment
from benchmark.experiment.runs import runs_of
from benchmark.experiment.version import ALL, FILE, frozen_text
from benchmark.running.played import scenarios_by_traffic
from smarts.errors import SmartsError


def training_of(experiment: Experiment) -> dict[str, dict[str, Any]]:
    """Return the budgets of an experiment by cell, and how its algorithms share parameters."""
    runs = [*runs_of(experiment)]
    sharing = {run.label: run.settings.get("sharing") for run in runs}
    most = Counter(sharing.values()).most_common(1)[0][0]
    budgets = {
        f"{run.task_setting.task.name}/{run.task_setting.traffic}": run.content()["budget"] for run in runs
    }
    return {
        "budget": budgets,
        "sharing": {ALL: most} | {name: each for name, each in sharing.items() if each != most},
    }


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Freeze a version of the benchmark.")
    parser.add_argument("version", type=int)
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--replace", action="store_true", help="freeze again; there are no results of it")
    given = parser.parse_args()
    experiment = read_experiment(given.experiment)
    played, environment = scenarios_by_traffic(experiment), experiment.environment
    try:
        training = training_of(experiment)
        text = frozen_text(given.version, played, environment, training=training, replaces=given.replace)
    except SmartsError as error:
        parser.exit(1, f"error: {error}\n")
    FILE.write_text(text)
    print(f"wrote {FILE}")


if __name__ == "__main__":
    main()
