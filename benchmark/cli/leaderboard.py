"""`smarts-bench leaderboard`: many experiments, ranked."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

Results = Annotated[
    list[Path],
    typer.Argument(metavar="RESULTS...", help="Experiments' results: results/NAME.", show_default=False),
]
Out = Annotated[Path, typer.Option(help="Page to write.")]
Mode = Annotated[Literal["greedy", "sampled"], typer.Option(help="Which test episodes count.")]


def leaderboard(results: Results, out: Out = Path("leaderboard.html"), mode: Mode = "greedy") -> None:
    """Rank all algorithms of RESULTS in each task and traffic, on a page that sorts and filters."""
    from benchmark.report.leaderboard_page import write_leaderboard

    write_leaderboard(results, out, mode)
    typer.echo(out)
