"""The command line, `smarts-bench`. Commands import what they need when they run, so that help is instant."""

from __future__ import annotations

import sys

import typer

from algorithms.errors import AlgorithmError
from benchmark.cli import (
    algorithms,
    compare,
    doctor,
    evaluate,
    floors,
    leaderboard,
    render,
    report,
    run,
    scenario,
    sweep,
)
from smarts.errors import SmartsError

app = typer.Typer(
    help="Multi-agent reinforcement learning for autonomous driving: simulate, train, evaluate, report.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.add_typer(scenario.app, name="scenario")
app.command()(run.run)
app.command()(sweep.sweep)
app.command()(evaluate.evaluate)
app.command()(doctor.doctor)
app.command()(render.render)
app.command()(floors.floors)
app.command()(report.report)
app.command()(leaderboard.leaderboard)
app.command()(compare.compare)
app.command("algorithms")(algorithms.list_algorithms)


@app.callback()
def _smarts_bench() -> None:
    """Keep the commands in groups even where a group is the only one."""


def main() -> None:
    """Run the command line; what the user can mend is one message and exit code 2."""
    try:
        app()
    except (SmartsError, AlgorithmError) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(SmartsError.exit_code)
