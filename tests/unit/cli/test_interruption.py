"""Ctrl-C in commands that keep nothing: one line, and the exit code of a signal."""

import typer
from typer.testing import CliRunner

from benchmark.cli import Interruptible, app


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
