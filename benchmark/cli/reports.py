"""`smarts-bench report`, `leaderboard` and `compare`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from benchmark.cli.lists import aligned

if TYPE_CHECKING:
    from benchmark.metrics.results import Frame

Mode = Annotated[Literal["greedy", "sampled"], typer.Option(help="Test episodes to use.")]
Results = Annotated[
    Path, typer.Argument(metavar="RESULTS", help="Results folder, results/NAME.", show_default=False)
]
SIDE = "results/NAME or results/NAME/ALGORITHM."
TITLES = {
    "first": "first",
    "second": "second",
    "task": "task",
    "task_traffic": "traffic",
    "metric": "metric",
    "value": "difference",
    "interval": "95% interval",
    "pairs": "starts",
    "seeds": "seeds",
    "p_value": "p",
    "corrected": "corrected p",
    "better": "better",
}
"""Column of the table of `compare` -> its title."""


def report(
    results: Results,
    out: Annotated[
        Path | None, typer.Option(help="Folder to write to.", show_default="RESULTS/report")
    ] = None,
) -> None:
    """Write the report of an experiment (HTML, Markdown, CSV, LaTeX), finished or not."""
    from benchmark.report.writing import write_report

    typer.echo(write_report(results, out))


def leaderboard(
    results: Annotated[
        list[Path],
        typer.Argument(metavar="RESULTS", help="Results folders, results/NAME.", show_default=False),
    ],
    out: Annotated[Path, typer.Option(help="HTML file to write.")] = Path("leaderboard.html"),
    mode: Mode = "greedy",
) -> None:
    """Rank the algorithms of several experiments on one page.

    Of several paths, files and folders that are no experiment's are left out, and named.
    """
    from benchmark.report.leaderboard import write_leaderboard
    from benchmark.results.reading import holds_results

    kept = [root for root in results if not root.exists() or holds_results(root)]
    if kept:  # else all are named as errors
        for root in sorted({*results} - {*kept}):
            typer.echo(f"note: {root} has no results of an experiment: left out", err=True)
    write_leaderboard(kept or results, out, mode)
    typer.echo(out)


def compare(
    a: Annotated[Path, typer.Argument(metavar="A", help=SIDE, show_default=False)],
    b: Annotated[Path, typer.Argument(metavar="B", help=SIDE, show_default=False)],
    metric: Annotated[
        list[str] | None,
        typer.Option(
            "--metric", help="Metric to compare. Repeatable.", show_default="completion and collision rate"
        ),
    ] = None,
    mode: Mode = "greedy",
    csv: Annotated[
        Path | None, typer.Option("--csv", help="CSV file to write as well.", show_default=False)
    ] = None,
) -> None:
    """Compare two experiments or two algorithms at equal starts.

    Prints A minus B for each common algorithm, with p-values Holm-corrected over all lines.

    An observation is a start, averaged over training seeds.

    So results are about these checkpoints, not about further trainings of the algorithm.
    """
    from benchmark.report.comparing import (
        compare_sides,
        differing_protocols,
        only_one_has,
        read_side,
        runs_apart,
        with_distinct_names,
    )
    from benchmark.report.ranking import RANKED_BY
    from benchmark.report.values import as_csv
    from benchmark.report.wording import pairs_notes
    from benchmark.results.files import write_whole

    first, second = with_distinct_names(read_side(a), read_side(b))
    found = compare_sides(first, second, metric or RANKED_BY, mode)
    differing = differing_protocols(first, second)
    if differing:
        typer.echo("note: the protocols differ:", err=True)
        for line in differing:
            typer.echo(f"  {line}", err=True)
    for side in (first, second):
        for line in side.left_out:
            typer.echo(f"note: left out: {side.name}: {line}", err=True)
    for line in only_one_has(first, second):
        typer.echo(f"note: left out: {line}", err=True)
    for line in runs_apart(first, second):
        typer.echo(f"note: {line}", err=True)
    if csv is not None:
        write_whole(csv, lambda file: file.write_text(as_csv(found), encoding="utf-8"))
    typer.echo(_shown(found))
    for note in pairs_notes(found["note"]):
        typer.echo(f"note: {note}", err=True)


def _shown(found: Frame) -> str:
    return "\n".join(aligned([[*TITLES.values()], *map(_line, found.to_dict("records"))]))


def _line(row: dict[Any, Any]) -> list[str]:
    """Return a row of `compare_sides` as text, in the order of `TITLES`; NaN differs from itself."""
    from benchmark.report.values import p_text

    is_compared = row["corrected"] == row["corrected"]
    known = row["low"] == row["low"]
    return [
        *(str(row[name]) for name in ("first", "second", "task", "task_traffic", "metric")),
        f"{row['value']:+z.3f}" if row["value"] == row["value"] else "n/a",
        f"[{row['low']:+z.3f}, {row['high']:+z.3f}]" if known else "no interval",
        str(row["pairs"]),
        f"{row['first_seeds']} / {row['second_seeds']}",
        *(p_text(row[name]) if is_compared else "" for name in ("p_value", "corrected")),
        row["better"] or ("tie" if is_compared else "not compared"),
    ]
