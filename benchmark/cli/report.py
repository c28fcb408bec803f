"""`smarts-bench report`: pages, tables and plots of an experiment."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Results = Annotated[Path, typer.Argument(help="An experiment's results: results/NAME.", show_default=False)]
Out = Annotated[
    Path | None, typer.Option(help="Folder to write to; by default RESULTS/report.", show_default=False)
]


def report(results: Results, out: Out = None) -> None:
    """Make the report of RESULTS again from what is on disk, finished or not: HTML, Markdown, CSV, LaTeX."""
    from benchmark.report.writing import write_report

    typer.echo(write_report(results, out))
