"""Freeze what an experiment plays as a version of the benchmark.

    python results/freeze_version.py 1 configs/paper_table.yaml

Writes digests of its scenarios, and of the code of observations, rewards and metrics, into
`benchmark/experiment/versions.yaml`. Runs with `benchmark_version: 1` are refused while something differs.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from benchmark.experiment.config import read_experiment
from benchmark.experiment.version import FILE, frozen_text
from benchmark.running.played import scenarios_by_traffic


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Freeze a version of the benchmark.")
    parser.add_argument("version", type=int)
    parser.add_argument("experiment", type=Path)
    given = parser.parse_args()
    FILE.write_text(frozen_text(given.version, scenarios_by_traffic(read_experiment(given.experiment))))
    print(f"wrote {FILE}")


if __name__ == "__main__":
    main()
