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
    doctor,
    experiments,
    releases,
    render,
    reports,
    robustness,
    scenario,
    scripted,
    settings,
    view,
    zoo,
)
from benchmark.running.exit_codes import INTERRUPTED
from smarts.errors import SmartsError


class Interruptible(TyperGroup):
    """Ends any command at Ctrl-C with one line; commands that keep results print more (`interruptible`)."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
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
        except typer.Exit:  # a RuntimeError of a command that has printed its message
            raise
        except BaseException as error:
            # LLVM swallows a Ctrl-C while it compiles a kernel; numba then raises that the kernel is missing.
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
app.command()(experiments.run)
app.command()(experiments.sweep)
app.command()(experiments.evaluate)
app.command()(robustness.robustness)
app.command()(scripted.scripted)
app.command()(reports.report)
app.command()(reports.compare)
app.command()(reports.leaderboard)
app.command()(reports.check_traffic)
app.command("algorithms")(experiments.list_algorithms)
app.command()(settings.settings)
app.command()(settings.schema)
app.add_typer(scenario.app, name="scenario")
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
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # File names may have letters that the terminal cannot show.
            stream.reconfigure(errors="backslashreplace")
    try:
        app()
    except (SmartsError, AlgorithmError) as error:
        _fail(str(error))
    except OSError as error:
        # Errors of named files are `ResultsError`s; one without a name is of an open file, such as stdout.
        if error.errno != errno.ENOSPC or error.filename is not None:
            raise
        # Python flushes stdout when it ends, which would fail once more.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        _fail(
            "the output cannot be written: there is no room left where it goes, or on the disk it writes to\n"
            "  remedy: make room, or write it elsewhere"
        )


def _fail(message: str) -> NoReturn:
    print(f"error: {message}", file=sys.stderr)
    sys.exit(SmartsError.exit_code)
