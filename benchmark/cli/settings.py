"""`smarts-bench settings` and `smarts-bench schema`: what experiment files may say."""

from __future__ import annotations

import json
from typing import Annotated

import typer


def settings(algorithm: Annotated[str, typer.Argument(help="A name, or module:Class of own code.")]) -> None:
    """List the settings of an algorithm: name, default, allowed values, meaning."""
    from benchmark.experiment.algorithm_settings import settings_table

    rows = settings_table(algorithm)
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)][:-1]
    for *row, meaning in rows:
        line = "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True))
        typer.echo(f"{line}  {meaning}")


def schema() -> None:
    """Print the JSON schema of experiment files, by which editors complete and check them."""
    from benchmark.experiment.schema import schema

    typer.echo(json.dumps(schema(), indent=1))
