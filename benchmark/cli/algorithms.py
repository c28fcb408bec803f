"""`smarts-bench algorithms`: the table of algorithms. Loads neither torch nor Ray."""

from __future__ import annotations

import typer

from algorithms.registry import ALGORITHMS, Entry, Paradigm

HEADER = ("name", "paradigm", "level", "communication", "actions", "recurrent", "what it is")
SHORT = {Paradigm.CTDE: "CTDE"}


def list_algorithms() -> None:
    """List the algorithms: paradigm, level of intelligence M0-M5, communication, actions, recurrence."""
    rows = [HEADER, *(_row(name, entry) for name, entry in ALGORITHMS.items())]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        line = "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True))
        typer.echo(line.rstrip())
    for paradigm, short in SHORT.items():
        typer.echo(f"\n{short}: {paradigm}")


def _row(name: str, entry: Entry) -> tuple[str, ...]:
    return (
        name,
        SHORT.get(entry.paradigm, entry.paradigm.value),
        entry.level,
        _yes(entry.communication),
        entry.actions.value,
        _yes(entry.recurrent),
        entry.summary,
    )


def _yes(tag: bool) -> str:
    return "yes" if tag else "no"
