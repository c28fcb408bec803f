"""The command line, `smarts-bench`. Commands import what they need when they run, so that help is instant."""

from __future__ import annotations

import errno
import io
import os
import signal
import sys
from types import FrameType
from typing import Any, NoReturn

import typer
from typer.core import TyperGroup

from algorithms.errors import AlgorithmError
from benchmark.cli import (
    algorithms,
    compare,
    doctor,
    evaluate,
    floors,
    kernels,
    leaderboard,
    render,
    report,
    run,
    scenario,
    settings,
    sweep,
)
from benchmark.running.exit_codes import INTERRUPTED
from smarts.errors import SmartsError


class Interruptible(TyperGroup):
    """Commands that Ctrl-C ends with one line; those that keep something say more (`interruptible`)."""

    def invoke(self, ctx: Any) -> Any:
        """Do what was asked for."""
        is_interrupted = False

        def interrupt(number: int, frame: FrameType | None) -> None:
            nonlocal is_interrupted
            is_interrupted = True
            raise KeyboardInterrupt

        is_ours = signal.getsignal(signal.SIGINT) is signal.default_int_handler
        if is_ours:
            signal.signal(signal.SIGINT, interrupt)
        try:
            return super().invoke(ctx)
        except typer.Exit:  # a RuntimeError of a command that has said all that there is to say
            raise
        except BaseException as error:
            # While kernels are compiled, Ctrl-C is lost in LLVM, and comes out as that there is no kernel.
            if isinstance(error, KeyboardInterrupt) or (is_interrupted and isinstance(error, RuntimeError)):
                print("interrupted", file=sys.stderr)
                raise typer.Exit(INTERRUPTED) from None
            raise
        finally:
            if is_ours:
                signal.signal(signal.SIGINT, signal.default_int_handler)


app = typer.Typer(
    cls=Interruptible,
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
app.command("compile")(kernels.compile_kernels)
app.command()(render.render)
app.command()(floors.floors)
app.command()(report.report)
app.command()(leaderboard.leaderboard)
app.command()(compare.compare)
app.command("algorithms")(algorithms.list_algorithms)
app.command()(settings.settings)
app.command()(settings.schema)


@app.callback()
def _smarts_bench() -> None:
    """Keep the commands in groups even where a group is the only one."""


def main() -> None:
    """Run the command line; what the user can mend is one message and exit code 2."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # Names of files may have letters that the terminal has not.
            stream.reconfigure(errors="backslashreplace")
    try:
        app()
    except (SmartsError, AlgorithmError) as error:
        _fail(str(error))
    except OSError as error:
        # What says where is told by whoever wrote there; an open file that is written to says nothing.
        if error.errno != errno.ENOSPC or error.filename is not None:
            raise
        # What is still to be written would fail once more when Python ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        _fail(
            "the output cannot be written: there is no room left where it goes, or on the disk it writes to\n"
            "  remedy: make room, or write it elsewhere"
        )


def _fail(message: str) -> NoReturn:
    print(f"error: {message}", file=sys.stderr)
    sys.exit(SmartsError.exit_code)
