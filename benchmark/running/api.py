"""Experiments from Python: what `smarts-bench run` does with a file."""

from __future__ import annotations

from pathlib import Path

from benchmark.experiment.config import Experiment, check_whole, read_experiment
from benchmark.results.reading import Results, read_results
from benchmark.running.experiment import run_experiment


def run(experiment: Experiment | str | Path, out: str | Path = "results") -> Results:
    """Train and test an experiment, and return its results; what is finished already is not done again.

    Failed runs are printed to stderr and are among `Results.unfinished`. A script that calls this has to keep
    own code in files or packages of its own, which other processes can import.

    Args:
        experiment: What is to be run, or the file that says so; an experiment made in Python needs a name.
        out: Folder of all results; the experiment's own is in it.

    Raises:
        ConfigError: With all mistakes that an experiment file would be refused for.
        SmartsError: A scenario is wrong, or the folder cannot be used.
        KeyboardInterrupt: After Ctrl-C; the same call continues.
    """
    made = experiment if isinstance(experiment, Experiment) else read_experiment(Path(experiment))
    checked = check_whole(made)
    root = Path(out) / checked.name
    run_experiment(checked, root)
    return read_results(root)
