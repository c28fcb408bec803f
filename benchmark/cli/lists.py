"""`smarts-bench algorithms`, `settings` and `schema`: what experiment files may say."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from typing import Annotated

import typer

from algorithms.registry import ALGORITHMS, Paradigm

HEADER = ("name", "paradigm", "level", "communication", "actions", "recurrent", "description")
SHORT = {Paradigm.CTDE: "CTDE"}


def aligned(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Yield the lines of a table, with each column as wide as its longest text."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        yield "  ".join(f"{text:<{width}}" for text, width in zip(row, widths, strict=True)).rstrip()


def algorithms() -> None:
    """List all algorithms and their properties."""
    yes_no = {True: "yes", False: "no"}
    rows = [
        (
            name,
            SHORT.get(entry.paradigm, entry.paradigm.value),
            entry.level,
            yes_no[entry.communication],
            entry.actions.value,
            yes_no[entry.recurrent],
            entry.summary,
        )
        for name, entry in ALGORITHMS.items()
    ]
    typer.echo("\n".join(aligned([HEADER, *rows])))
    for paradigm, short in SHORT.items():
        typer.echo(f"\n{short}: {paradigm}")


def settings(algorithm: Annotated[str, typer.Argument(help="A name, or module:Class of own code.")]) -> None:
    """List the settings of an algorithm: name, default, allowed values, meaning."""
    from benchmark.experiment.algorithm_settings import settings_table

    typer.echo("\n".join(aligned(settings_table(algorithm))))


def schema() -> None:
    """Print the JSON schema of experiment files, by which editors complete and check them."""
    from benchmark.experiment.schema import schema

    typer.echo(json.dumps(schema(), indent=1))
