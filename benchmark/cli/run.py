"""`smarts-bench run`: from a config to a report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Config = Annotated[Path, typer.Argument(help="Experiment file (YAML).", show_default=False)]
Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        help="Change a value of the file, as in --set budget.minutes=5; may be repeated.",
        metavar="KEY=VALUE",
    ),
]
Import = Annotated[
    list[Path] | None,
    typer.Option(
        "--import",
        help="Python file or folder of your own, for names such as my_file:MyClass; may be repeated.",
        metavar="PATH",
        show_default=False,
    ),
]
Out = Annotated[Path, typer.Option(help="Folder of all results; the experiment's own is in it.")]


def run(config: Config, set_: Set = None, import_: Import = None, out: Out = Path("results")) -> None:
    """Train, test and report what CONFIG says. After any interruption the same command goes on."""
    from benchmark.experiment.config import read_experiment

    experiment = read_experiment(config, set_ or (), import_ or ())
    root = out / experiment.name
    # At once: loading Ray, building scenarios and starting Ray take a while.
    typer.echo(f"{experiment.name}: building scenarios and going through {root}", err=True)
    budget = experiment.budget
    until = f" or {budget.minutes:g} minutes, whichever ends first" if budget.minutes else ""
    typer.echo(f"each run trains for {budget.agent_steps:,} agent-steps{until}", err=True)
    from benchmark.report.writing import write_report
    from benchmark.running.experiment import goes_on, interruptible, run_experiment

    def work() -> int:
        code = run_experiment(experiment, root)
        typer.echo(f"report: {write_report(root)}")
        return code

    raise typer.Exit(interruptible(work, goes_on(root)))
