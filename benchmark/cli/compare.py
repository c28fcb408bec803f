"""`smarts-bench compare`: differences of two experiments or algorithms at equal starts."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

if TYPE_CHECKING:
    from benchmark.metrics.results import Frame

Side = Annotated[Path, typer.Argument(help="results/NAME or results/NAME/ALGORITHM.", show_default=False)]
Metrics = Annotated[
    list[str] | None,
    typer.Option(
        "--metric", help="What to compare; may be repeated.", show_default="completion and collision rate"
    ),
]
Mode = Annotated[Literal["greedy", "sampled"], typer.Option(help="Which test episodes count.")]
Csv = Annotated[Path | None, typer.Option("--csv", help="Table to write as well.", show_default=False)]


def compare(a: Side, b: Side, metric: Metrics = None, mode: Mode = "greedy", csv: Csv = None) -> None:
    """Show A minus B at the starts that both have played, p-values Holm-corrected over all lines.

    Of two experiments, the algorithms that both have; of two algorithms, these two. The unit is a start, over
    all training seeds a side has (column "seeds"): the answer is about these checkpoints, not about others of
    the algorithm.
    """
    from benchmark.report.comparing import (
        compare_sides,
        differing_protocols,
        read_side,
        scenarios_apart,
        told_apart,
    )
    from benchmark.report.ranking import RANKED_BY
    from benchmark.report.values import csv_number
    from benchmark.results.files import write_whole

    first, second = told_apart(read_side(a), read_side(b))
    found = compare_sides(first, second, metric or RANKED_BY, mode)
    differing = differing_protocols(first, second)
    if differing:
        typer.echo("note: these were not made under the same protocol:", err=True)
        for line in differing:
            typer.echo(f"  {line}", err=True)
    for side in (first, second):
        for line in side.left_out:
            typer.echo(f"note: left out: {side.name}: {line}", err=True)
    for line in scenarios_apart(first, second):
        typer.echo(f"note: {line}", err=True)
    if csv is not None:
        text = found.to_csv(index=False, float_format=csv_number, lineterminator="\n")
        write_whole(csv, lambda file: file.write_text(text, encoding="utf-8"))
    typer.echo(_shown(found))
    for note in dict.fromkeys(filter(None, found["note"])):
        typer.echo(f"note: left out: {note}", err=True)


def _shown(found: Frame) -> str:
    titles = [
        "first",
        "second",
        "task",
        "traffic",
        "metric",
        "difference",
        "95% interval",
        "starts",
        "seeds",
        "p",
        "corrected p",
        "better",
    ]
    lines = [titles, *map(_line, found.to_dict("records"))]
    widths = [max(len(line[column]) for line in lines) for column in range(len(titles))]
    return "\n".join(
        "  ".join(text.ljust(width) for text, width in zip(line, widths, strict=True)).rstrip()
        for line in lines
    )


def _line(row: dict[Any, Any]) -> list[str]:
    is_compared = row["corrected"] == row["corrected"]
    known = row["low"] == row["low"]
    return [
        *(str(row[name]) for name in ("first", "second", "task", "task_traffic", "metric")),
        f"{row['value']:+z.3f}" if row["value"] == row["value"] else "n/a",
        f"[{row['low']:+z.3f}, {row['high']:+z.3f}]" if known else "no interval",
        str(row["pairs"]),
        f"{row['first_seeds']} / {row['second_seeds']}",
        *(f"{row[name]:.3f}" if is_compared else "" for name in ("p_value", "corrected")),
        row["better"] or ("tie" if is_compared else "not compared"),
    ]
