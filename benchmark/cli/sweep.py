"""`smarts-bench sweep`: a search for settings."""

from __future__ import annotations

from pathlib import Path

import typer

from benchmark.cli.run import Config, Import, Out, Set


def sweep(config: Config, set_: Set = None, import_: Import = None, out: Out = Path("results")) -> None:
    """Search settings as CONFIG's `tune` says, with Ray Tune. Interrupted, the same command goes on."""
    from benchmark.experiment.config import read_experiment

    experiment = read_experiment(config, set_ or (), import_ or ())
    from benchmark.running.experiment import goes_on, interruptible
    from benchmark.running.sweeping import sweep as search

    root = out / experiment.name
    raise typer.Exit(interruptible(lambda: search(experiment, root), goes_on(root)))
