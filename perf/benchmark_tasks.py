"""Play an experiment's scripted policies, and check that its tasks tell good driving from bad.

    python -m perf.benchmark_tasks configs/benchmark_v1.yaml results/tasks [--set KEY=VALUE]...

Writes and prints what `smarts-bench run CONFIG --set algorithms=[]` and `smarts-bench check-traffic` do, in
this process, without Ray. What differs from the config's version is refused, but with `--set
benchmark_version=null`. Finished tests are not played again. Cells with social vehicles come first.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

from benchmark.experiment.config import EMPTY_ROADS, read_experiment
from benchmark.experiment.runs import scripted_runs_of
from benchmark.report.task_check import score_table, task_checks
from benchmark.report.traffic_check import traffic_checks
from benchmark.results.commands import keep_command
from benchmark.results.reading import read_results
from benchmark.results.run_folder import FINISHED, RunFolder
from benchmark.running.experiment import check_version
from benchmark.running.testing import play_scripted
from benchmark.running.writing import RunWriter


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("config", type=Path)
    parser.add_argument("results", type=Path)
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    given = parser.parse_args()
    experiment = read_experiment(given.config, given.set)
    check_version(experiment)
    keep_command(given.results, experiment, f"python -m perf.benchmark_tasks {given.config}")
    for run in sorted(scripted_runs_of(experiment), key=lambda run: run.task_setting.traffic == EMPTY_ROADS):
        folder = RunFolder(given.results / run.folder)
        if folder.status == FINISHED:
            continue
        begun = time.monotonic()
        writer = RunWriter(run, folder)
        with tempfile.TemporaryDirectory(prefix="smarts-tasks-") as scratch:
            for message in play_scripted(run, RunFolder(Path(scratch))):
                writer.take(message)
        writer.close()
        print(f"{run}: {time.monotonic() - begun:.0f} s", flush=True)
    results = read_results(given.results)
    print(score_table(results), *traffic_checks(results), *task_checks(results), sep="\n")


if __name__ == "__main__":
    main()
