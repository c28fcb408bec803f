"""Ctrl-C in commands that keep nothing: one line, and the exit code of a signal."""

import signal

import pytest
import typer
from typer.testing import CliRunner

from benchmark.cli import Interruptible, app


def commands_of(work):
    commands = typer.Typer(cls=Interruptible)

    @commands.callback()
    def group():
        pass

    commands.command("work")(work)
    return commands


def lost():
    """Take Ctrl-C and fail at something else for it, as a compiler does that is called back from C."""
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt:
        raise RuntimeError("no compiled object yet") from None


def interrupted():
    raise KeyboardInterrupt


@pytest.mark.parametrize("work", [interrupted, lost])
def test_ctrl_c_is_one_line_and_130(work):
    before = signal.getsignal(signal.SIGINT)
    ended = CliRunner().invoke(commands_of(work), ["work"])
    assert (ended.exit_code, ended.stderr, ended.stdout) == (130, "interrupted\n", "")
    assert signal.getsignal(signal.SIGINT) is before


def handled():
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt:
        print("saved")
        raise typer.Exit(130) from None


def test_a_command_that_has_taken_ctrl_c_itself_has_the_last_word():
    ended = CliRunner().invoke(commands_of(handled), ["work"])
    assert (ended.exit_code, ended.stderr, ended.stdout) == (130, "", "saved\n")


def test_an_error_without_ctrl_c_is_an_error():
    def fail():
        raise RuntimeError("no memory")

    assert isinstance(CliRunner().invoke(commands_of(fail), ["work"]).exception, RuntimeError)


def test_all_commands_end_so():
    assert isinstance(typer.main.get_command(app), Interruptible)


def test_a_table_that_is_written_is_not_said_to_be_missing(monkeypatch, tmp_path):
    def interrupted(table, agent):
        raise KeyboardInterrupt

    place = "benchmark.running.evaluate_checkpoint.evaluate_checkpoint"
    monkeypatch.setattr(place, lambda run, **options: "a table")
    monkeypatch.setattr("benchmark.cli.experiments.show_metrics", interrupted)
    ended = CliRunner().invoke(app, ["evaluate", "a_run", "--out", str(tmp_path)])
    assert (ended.exit_code, ended.stderr) == (130, "interrupted\n")
