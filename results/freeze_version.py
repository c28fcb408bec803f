"""Freeze what an experiment plays as a version of the benchmark.

    python results/freeze_version.py 1 configs/benchmark_v1.yaml

Writes digests of its scenarios, and of the code of observations, rewards and metrics, and its settings of the
environment into `benchmark/experiment/versions.yaml`. Runs with `benchmark_version: 1` are refused while
something differs. A version that is there is frozen again with `--replace` only.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from benchmark.experiment.config import read_experiment
from benchmark.experiment.version import FILE, frozen_text
from benchmark.running.played import scenarios_by_traffic
from smarts.errors import SmartsError


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
        text = frozen_text(given.version, played, environment, replaces=given.replace)
    except SmartsError as error:
        parser.exit(1, f"error: {error}\n")
    FILE.write_text(text)
    print(f"wrote {FILE}")


if __name__ == "__main__":
    main()
