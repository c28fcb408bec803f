"""`smarts-bench evaluate`: a trained policy, tested again or elsewhere."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from benchmark.cli.run import Import

if TYPE_CHECKING:
    import pandas as pd

MODES: tuple[Literal["greedy", "sampled"], ...] = ("greedy", "sampled")


def evaluate(
    run: Annotated[Path, typer.Argument(help="Folder of a run: it holds config.yaml and checkpoint/.")],
    scenario: Annotated[
        list[str] | None,
        typer.Option(help="Others than those of the training, perhaps with @VARIATION; may be repeated."),
    ] = None,
    traffic: Annotated[str | None, typer.Option(help="Another variation of the traffic.")] = None,
    episodes: Annotated[int, typer.Option(help="Episodes for each way of acting.", min=1)] = 50,
    mode: Annotated[list[str] | None, typer.Option(help="greedy or sampled; by default both.")] = None,
    checkpoint: Annotated[Literal["last", "best"], typer.Option(help="best: in validation.")] = "last",
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the table and the recorded episodes; else neither is kept."),
    ] = None,
    import_: Import = None,
) -> None:
    """Test the policy of RUN and print all metrics with 95% intervals."""
    modes = _modes(mode)
    from benchmark.running.again import evaluate_again
    from benchmark.running.experiment import interruptible

    table: pd.DataFrame | None = None

    def work() -> int:
        nonlocal table
        table = evaluate_again(
            run,
            scenarios=scenario or (),
            traffic=traffic,
            episodes=episodes,
            modes=modes,
            checkpoint=checkpoint,
            out=out,
            imports=import_ or (),
        )
        return 0

    left = "nothing was written" if out is None else f"no table was written to {out}"
    code = interruptible(work, left)
    if table is not None:
        _show(table)
    raise typer.Exit(code)


def _show(table: pd.DataFrame) -> None:
    """Print all metrics of a test."""
    from benchmark.metrics import compute

    found = compute(table, ["mode"])
    for name, group in found.groupby("mode"):
        rows = group.to_dict("records")
        typer.echo(f"{name}: {rows[0]['n']} agent-episodes")
        for row in rows:
            interval = f"[{row['low']:z.3f}, {row['high']:z.3f}]" if row["low"] == row["low"] else ""
            value = f"{row['value']:z.3f}" if row["value"] == row["value"] else "n/a"
            typer.echo(f"  {row['metric']:<24} {value:>8}  {interval:<18} {row['note']}".rstrip())


def _modes(given: list[str] | None) -> tuple[Literal["greedy", "sampled"], ...]:
    # Typer takes no list of literals.
    for name in given or ():
        if name not in MODES:
            raise typer.BadParameter(f"{name!r} is neither greedy nor sampled", param_hint="--mode")
    return tuple(name for name in MODES if not given or name in given)
