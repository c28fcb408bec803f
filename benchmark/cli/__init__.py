"""The command line, `smarts-bench`. Commands import what they need when they run, so that help is instant."""

from __future__ import annotations

import sys
from typing import Any

import typer
from typer.core import TyperGroup

from algorithms.errors import AlgorithmError
from benchmark.cli import (
    data,
    doctor,
    experiments,
    lists,
    releases,
    render,
    reports,
    robustness,
    scenario,
    view,
    zoo,
)
from benchmark.running.exit_codes import INTERRUPTED
from smarts.errors import SmartsError


class Interruptible(TyperGroup):
    """Ends any command at Ctrl-C with one line; commands that keep results print more (`interruptible`)."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            print("interrupted", file=sys.stderr)
            raise typer.Exit(INTERRUPTED) from None


app = typer.Typer(
    cls=Interruptible,
    help="Multi-agent reinforcement learning for autonomous driving: simulate, train, evaluate, report.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.command()(experiments.run)
app.command()(experiments.sweep)
app.command()(experiments.evaluate)
app.command()(data.realism)
app.command()(robustness.robustness)
app.command()(reports.report)
app.command()(reports.compare)
app.command()(reports.leaderboard)
app.command()(lists.algorithms)
app.command()(lists.settings)
app.command()(lists.schema)
app.add_typer(scenario.app, name="scenario")
app.add_typer(data.app, name="data")
app.command()(data.demonstrations)
app.add_typer(zoo.app, name="zoo")
app.command()(zoo.export)
app.command()(zoo.serve)
app.command()(releases.release)
app.command()(releases.verify)
app.command()(render.render)
app.command()(view.view)
app.command()(doctor.doctor)
app.command("compile")(doctor.compile_kernels)


def main() -> None:
    """Run the command line; a user's mistake is one message and exit code 2."""
    try:
        app()
    except (SmartsError, AlgorithmError) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(SmartsError.exit_code)
