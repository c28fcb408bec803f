"""Ctrl-C in commands that keep nothing: one line, and the exit code of a signal."""

import typer
from typer.testing import CliRunner

from benchmark.cli import Interruptible, app


def interrupted(*given):
    raise KeyboardInterrupt


def test_ctrl_c_is_one_line_and_130():
    commands = typer.Typer(cls=Interruptible)

    @commands.callback()
    def group():
        pass

    @commands.command()
    def work():
        raise KeyboardInterrupt

    ended = CliRunner().invoke(commands, ["work"])
    assert (ended.exit_code, ended.stderr, ended.stdout) == (130, "interrupted\n", "")
    assert isinstance(typer.main.get_command(app), Interruptible)


def test_a_table_that_is_written_is_not_said_to_be_missing(monkeypatch, tmp_path):
    place = "benchmark.running.evaluate_checkpoint.evaluate_checkpoint"
    monkeypatch.setattr(place, lambda run, **options: "a table")
    monkeypatch.setattr("benchmark.cli.experiments.show_metrics", interrupted)
    ended = CliRunner().invoke(app, ["evaluate", "a_run", "--out", str(tmp_path)])
    assert (ended.exit_code, ended.stderr) == (130, "interrupted\n")
