"""`smarts-bench data`: recorded traffic."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(help="Import recorded traffic.", no_args_is_help=True)


@app.callback()
def data() -> None:
    """Import recorded traffic."""


@app.command("import")
def import_data(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="SOURCE", help="File of the recording, or folder of an episode.", show_default=False
        ),
    ],
    out: Annotated[Path, typer.Option(help="Folder to write, new or empty.", show_default=False)],
    licence: Annotated[
        str, typer.Option(help="Licence of the data, which stays with it.", show_default=False)
    ] = "",
    format: Annotated[
        str | None, typer.Option(help="Format of the source.", show_default="recognised by the file")
    ] = None,
    map_file: Annotated[
        Path | None,
        typer.Option("--map", help="Map of the recording.", show_default="the source's own, if it has one"),
    ] = None,
    attribution: Annotated[str, typer.Option(help="Whom to name.", show_default="as the source says")] = "",
    as_recorded: Annotated[bool, typer.Option("--as-recorded", help="Leave out the repairs.")] = False,
) -> None:
    """Make recorded traffic a scenario, and say what is implausible in it."""
    from smarts.recordings.importing import import_recording
    from smarts.recordings.reading import Source

    lines = import_recording(
        Source(source),
        out,
        licence=licence,
        format=format,
        attribution=attribution,
        map_file=map_file,
        as_recorded=as_recorded,
    )
    for line in [*lines, f"wrote {out}"]:
        typer.echo(line)


def demonstrations(
    scenario: Annotated[
        str, typer.Argument(metavar="SCENARIO", help="Scenario, or SCENARIO@VARIATION.", show_default=False)
    ],
    out: Annotated[Path, typer.Option(help="Parquet file to write.", show_default=False)],
    observation: Annotated[
        str, typer.Option(help="What agents observe, as `environment: {observation: ...}` has it.")
    ] = "[car_following]",
    action: Annotated[
        str, typer.Option(help="How they act: Direct, AlongPath, LaneWithContinuousSpeed or Lane.")
    ] = "Direct",
    decision_interval: Annotated[int, typer.Option(help="Steps of 0.1 s between decisions.", min=1)] = 5,
    traffic: Annotated[str | None, typer.Option(help="Traffic variation.", show_default="the last")] = None,
    episodes: Annotated[int, typer.Option(help="Number of episodes of the traffic.", min=1)] = 1,
    seconds: Annotated[
        float | None, typer.Option(help="Length of each (s).", show_default="to a recording's end, else 60")
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the run.")] = 42,
) -> None:
    """Write what a traffic's vehicles observe, and the actions that explain their motion, for imitation."""
    import yaml

    from smarts.env.demonstrations import demonstrate

    lines = demonstrate(
        scenario,
        out,
        traffic=traffic,
        observation=yaml.safe_load(observation),
        action=action,
        decision_interval=decision_interval,
        episodes=episodes,
        seconds=seconds,
        seed=seed,
    )
    typer.echo("\n".join([*lines, f"wrote {out}"]))


def realism(
    scenario: Annotated[
        str,
        typer.Argument(metavar="SCENARIO", help="Scenario with recorded traffic, or SCENARIO@VARIATION."),
    ],
    traffic: Annotated[
        str | None, typer.Option(help="Traffic variation.", show_default="the last that is recorded")
    ] = None,
    policy: Annotated[
        list[str] | None,
        typer.Option(help="Folder of a run, or agent of the zoo. Repeatable.", show_default=False),
    ] = None,
    engine: Annotated[
        list[str] | None, typer.Option(help="Traffic engine. Repeatable.", show_default="SUMO")
    ] = None,
    rollouts: Annotated[int, typer.Option(help="How often each scene is played.", min=1)] = 32,
) -> None:
    """Measure how realistic drivers are: in the place of recorded vehicles, for 5 s.

    The log itself is the ceiling; constant speed and IDM on the recorded path are floors.
    """
    import pandas as pd

    from benchmark.running.realism import measure_realism

    drivers = {"policies": policy or (), "engines": engine or ("SUMO",)}
    rows = measure_realism(scenario, traffic=traffic, rollouts=rollouts, **drivers)
    typer.echo(pd.DataFrame(rows).to_string(index=False, float_format="%.3f", na_rep="n/a"))
