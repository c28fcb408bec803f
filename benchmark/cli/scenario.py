"""`smarts-bench scenario`: list, build, show and run scenarios."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from smarts.sstudio.built import BuiltScenario

app = typer.Typer(help="List, build, show and run scenarios.", no_args_is_help=True)

Scenario = Annotated[
    str, typer.Argument(help="a name of the suite, or a folder; append @NAME for a held-out variation")
]
Seed = Annotated[int, typer.Option(help="seeds every random draw")]
Traffic = Annotated[str | None, typer.Option(help="traffic variation [default: the busiest, which is the last]")]
TRAFFIC_OF_THE_SUITE = "random_social_vehicles"


@app.command("list")
def list_scenarios() -> None:
    """List the scenarios of the suite."""
    from smarts.sstudio.suite import suite

    names = suite()
    width = max(map(len, names), default=0)
    for name, description in names.items():
        typer.echo(f"{name:<{width}}  {description}")


@app.command()
def build(
    scenarios: Annotated[
        list[str] | None, typer.Argument(help="names of the suite, or folders with a scenario.py or a map")
    ] = None,
    everything: Annotated[bool, typer.Option("--all", help="build the whole suite")] = False,
    seed: Seed = 42,
) -> None:
    """Build scenarios by hand. Running one builds it too, when it is new or changed."""
    from smarts.sstudio.build import build_scenario
    from smarts.sstudio.suite import suite

    chosen = list(suite()) if everything else scenarios or []
    if not chosen:
        raise typer.BadParameter("name a scenario, or give --all")
    for name in chosen:
        begin = time.perf_counter()
        built = build_scenario(name, seed=seed)
        took = time.perf_counter() - begin
        roads = built.roads()
        typer.echo(
            f"{built.name}: {len(roads.edge_ids)} edges, {len(roads.lane_ids)} lanes, "
            f"{len(built.traffic)} traffic, {len(built.held_out)} held-out variations "
            f"({took:.2f} s) -> {built.directory}"
        )
        for note in built.notes:
            typer.echo(f"  note: {note}")
