"""`smarts-bench run`, `sweep` and `evaluate`."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from benchmark.cli.choices import check_effect

if TYPE_CHECKING:
    import pandas as pd


Config = Annotated[Path, typer.Argument(metavar="CONFIG", help="Experiment file (YAML).", show_default=False)]
Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        help="Override a value of the file, e.g. --set budget.minutes=5. Repeatable.",
        metavar="KEY=VALUE",
    ),
]
Parallel = Annotated[
    int | None,
    typer.Option(help="How many to play at a time, in processes.", min=1, show_default="one for each core"),
]
Import = Annotated[
    list[Path] | None,
    typer.Option(
        "--import",
        help="Python file or package with your own code, named as MODULE:CLASS. Repeatable.",
        metavar="PATH",
        show_default=False,
    ),
]
Out = Annotated[Path, typer.Option(help="Parent folder of the experiment's results.")]


class Mode(StrEnum):
    """Action selection."""

    GREEDY = "greedy"
    SAMPLED = "sampled"


RATES = ("collision_rate", "completion_rate")
"""Metrics of each of several scenarios."""


def run(config: Config, set_: Set = None, import_: Import = None, out: Out = Path("results")) -> None:
    """Train, evaluate and report an experiment. Give the same command again to resume."""
    from benchmark.experiment.config import read_experiment

    experiment = read_experiment(config, set_ or (), import_ or ())
    root = out / experiment.name
    # Printed first, since loading Ray, building scenarios and starting Ray take a while.
    typer.echo(f"{experiment.name}: building scenarios, checking {root}", err=True)
    from benchmark.report.writing import write_report
    from benchmark.running.experiment import interruptible, resumable, run_experiment

    def work() -> int:
        code = run_experiment(experiment, root)
        typer.echo(f"report: {write_report(root)}")
        return code

    raise typer.Exit(interruptible(work, resumable(root)))


def sweep(config: Config, set_: Set = None, import_: Import = None, out: Out = Path("results")) -> None:
    """Search hyper-parameters with Ray Tune (section `tune`). Give the same command again to resume."""
    from benchmark.experiment.config import read_experiment

    experiment = read_experiment(config, set_ or (), import_ or ())
    from benchmark.running.experiment import interruptible, resumable
    from benchmark.running.sweeping import sweep as search

    root = out / experiment.name
    raise typer.Exit(interruptible(lambda: search(experiment, root), resumable(root)))


def evaluate(
    run: Annotated[
        Path | None,
        typer.Argument(
            metavar="[RUN]",
            help="Folder of a run, with config.yaml and checkpoint/, or of an exported policy.",
            show_default=False,
        ),
    ] = None,
    agent: Annotated[
        str | None,
        typer.Option(
            help="In place of a run: an agent of the zoo, or tcp://HOST:PORT of one that is served.",
            show_default=False,
        ),
    ] = None,
    agents: Annotated[
        int | None,
        typer.Option(
            help="Number of egos; of a trained policy, one that agents share.",
            min=1,
            max=64,
            show_default="4, or those of the training",
        ),
    ] = None,
    scenario: Annotated[
        list[str] | None,
        typer.Option(
            help="Scenario, or SCENARIO@VARIATION. Repeatable.",
            show_default="the conditions of the run's test",
        ),
    ] = None,
    traffic: Annotated[
        str | None, typer.Option(help="Traffic variation.", show_default="that of the training")
    ] = None,
    engine: Annotated[
        str | None, typer.Option(help="Traffic engine.", show_default="SUMO, or that of the training's tests")
    ] = None,
    episodes: Annotated[
        int, typer.Option(help="Number of episodes for each mode and condition.", min=1)
    ] = 50,
    mode: Annotated[
        list[Mode] | None, typer.Option(help="Action selection. Repeatable.", show_default="both")
    ] = None,
    checkpoint: Annotated[
        Literal["last", "best"] | None,
        typer.Option(help="Last checkpoint, or the best one in validation; of a run.", show_default="last"),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for the table and the recorded episodes, new or empty.", show_default="not kept"
        ),
    ] = None,
    import_: Import = None,
) -> None:
    """Evaluate a trained policy, or an agent, and print all metrics with 95% intervals."""
    if (run is None) == (agent is None):
        raise typer.BadParameter("give the folder of a run, or --agent", param_hint="RUN")
    is_exported = run is not None and (run / "policy.json").exists()
    if agent or is_exported:
        acting = None if is_exported and mode == [Mode.GREEDY] else mode
        place = "what is no run's folder: it acts in one way, greedily if it is trained"
        check_effect(place, {"--checkpoint": checkpoint, "--mode": acting})
    if agent and not scenario:
        raise typer.BadParameter("give at least one scenario", param_hint="--scenario")
    from benchmark.running.experiment import interruptible

    table: pd.DataFrame | None = None

    def work() -> int:
        nonlocal table
        from benchmark.running import evaluating  # loads torch and Ray

        asked = evaluating.Asked(scenario or (), traffic, episodes, agents, engine, out, import_ or ())
        if agent is not None:
            table = evaluating.evaluate_agent(agent, asked)
        elif run is not None and is_exported:
            table = evaluating.evaluate_exported(run, asked)
        elif run is not None:
            modes: Any = tuple(each.value for each in Mode if not mode or each in mode)
            last = checkpoint or "last"
            table = evaluating.evaluate_checkpoint(run, asked, modes=modes, checkpoint=last)
        return 0

    left = "nothing was written" if out is None else f"no table was written to {out}"
    code = interruptible(work, left)
    if table is not None:
        show_metrics(table, agent)
    raise typer.Exit(code)


def show_metrics(table: pd.DataFrame, agent: str | None = None) -> None:
    """Print all metrics of a test, headed by each mode, or by the locator of the agent that drove.

    Of several conditions, or scenarios, there is a row for each, too, and always one for agents whose ways
    meet others', and for the others.
    """
    from benchmark.metrics import METRICS, compute
    from benchmark.report.tables import meeting_shares, meets
    from benchmark.results.reading import played_in
    from benchmark.running.testing import ENGINE

    table = table.assign(played=played_in(table))
    for name, group in compute(table, ["mode"]).groupby("mode"):
        rows = group.to_dict("records")
        places = [*table.loc[table["mode"] == name, "played"].unique()]
        traffic = ", ".join(table.loc[table["mode"] == name, "traffic"].unique())
        played = ", ".join(filter(None, [*places, traffic, table.attrs.get(ENGINE)]))
        typer.echo(f"{agent or name}: {rows[0]['n']} agent-episodes of {played}")
        for row in rows:
            unit = METRICS[row["metric"]].unit
            label = f"{row['metric']} [{unit}]" if unit else row["metric"]
            typer.echo(f"  {label:<27} {_value(row)} {row['note']}".rstrip())
        for place in places:
            own: pd.DataFrame = table.loc[(table["mode"] == name) & (table["played"] == place)]
            if len(places) > 1:
                typer.echo(f"  {place}: {_rates(own)}")
            if shares := meeting_shares(own):
                typer.echo(f"    agents, and episodes, with ways that meet within 5 s: {shares}")
            for which, words in ((1, "agents that meet"), (0, "others")):
                if len(part := own.loc[meets(own) == which]):
                    typer.echo(f"    {words}: {_rates(part)}")


def _rates(table: pd.DataFrame) -> str:
    """Return completion and collision rate in words."""
    from benchmark.metrics import compute

    rates = compute(table, [], RATES).to_dict("records")
    return "; ".join(f"{x['metric']} {_value(x).strip()}, {x['n']} agent-episodes" for x in rates)


def _value(row: Mapping[Hashable, Any]) -> str:
    interval = f"[{row['low']:z.3f}, {row['high']:z.3f}]" if row["low"] == row["low"] else ""
    value = f"{row['value']:z.3f}" if row["value"] == row["value"] else "n/a"
    return f"{value:>8}  {interval:<18}"
