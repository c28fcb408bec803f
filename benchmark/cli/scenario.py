"""`smarts-bench scenario`: list, build, show and run scenarios."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from benchmark.cli.choices import check_effect
from smarts.errors import SmartsError

if TYPE_CHECKING:
    from smarts.sstudio.built import BuiltScenario

app = typer.Typer(help="List, build, show and run scenarios.", no_args_is_help=True)

FORMATS = (".png", ".jpg", ".pdf", ".svg")
DAY = 86_400.0

SCENARIO = "Scenario name, folder or map file; NAME@VARIATION for a held-out variation."
Names = Annotated[list[str] | None, typer.Argument(metavar="SCENARIO", help=SCENARIO, show_default=False)]
Name = Annotated[str, typer.Argument(metavar="SCENARIO", help=SCENARIO, show_default=False)]
Seed = Annotated[int, typer.Option(help="Random seed of the traffic.", min=0, max=2**63 - 1)]
BuildSeed = Annotated[
    int | None,
    typer.Option(
        help="Random seed of the build.",
        show_default="that of the scenario file, or 42",
        min=0,
        max=2**63 - 1,
    ),
]
Traffic = Annotated[
    str | None, typer.Option(help="Traffic variation.", show_default="the last, which has the most vehicles")
]


@app.command("list")
def list_scenarios() -> None:
    """List the scenarios of the suite."""
    from smarts.sstudio.locating import suite

    names = suite()
    width = max(map(len, names), default=0)
    for name, description in names.items():
        typer.echo(f"{name:<{width}}  {description}")


@app.command()
def build(
    scenarios: Names = None,
    everything: Annotated[bool, typer.Option("--all", help="Build the whole suite.")] = False,
    seed: BuildSeed = None,
) -> None:
    """Build scenarios. Commands that use a scenario build it too, if it has changed."""
    from smarts.sstudio.build import build_scenario

    for name in _chosen(scenarios, everything):
        begin = time.perf_counter()
        built = build_scenario(name, seed=seed)
        roads = built.roads()
        took = time.perf_counter() - begin
        typer.echo(
            f"{built.name}: {len(roads.edge_ids)} edges, {len(roads.lane_ids)} lanes, "
            f"traffic {', '.join(built.traffic) or 'none'}; "
            f"{_held_out(built)} ({took:.2f} s)\n  {built.directory}"
        )
        for note in [*built.notes, *_agent_notes(built)]:
            typer.echo(f"  note: {note}")


@app.command("import")
def import_files(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...",
            help="A .sumocfg; or a .net.xml with route and additional files.",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(help="Folder of the scenario, new or empty.", show_default="named as the first file"),
    ] = None,
) -> None:
    """Make a scenario of SUMO's files, and build it."""
    from smarts.sstudio.build import build_scenario
    from smarts.sstudio.sumo_files import import_sumo

    folder, unused = import_sumo(files, out)
    built = build_scenario(folder)
    typer.echo(f"{folder}: {len(built.roads().edge_ids)} edges, traffic {', '.join(built.traffic) or 'none'}")
    if unused:
        typer.echo(f"  note: options without effect here: {', '.join(unused)}")


@app.command()
def show(
    scenarios: Names = None,
    out: Annotated[
        Path,
        typer.Option(help="Image file to write; the suffix selects the format (.png, .jpg, .pdf, .svg)."),
    ] = Path("scenario.png"),
    everything: Annotated[bool, typer.Option("--all", help="Draw the whole suite on one sheet.")] = False,
    traffic: Traffic = None,
    seconds: Annotated[
        float, typer.Option(help="Simulated time before the reset (s).", min=0.0, max=DAY)
    ] = 0.0,
    seed: Seed = 42,
    edges: Annotated[
        bool, typer.Option("--edges", help="Write the ids of the edges on their roads.")
    ] = False,
) -> None:
    """Draw lanes, missions, traffic flows, bubbles and the vehicles after a reset."""
    from smarts.envision.scenario_picture import scenario_picture, scenario_sheet
    from smarts.sim.moments import reset_moment
    from smarts.sstudio.build import build_scenario

    names = _chosen(scenarios, everything)
    _check_picture(out)
    pictures = []
    for name in names:
        built = build_scenario(name)
        chosen = _traffic_of(built, traffic)
        pictures.append((built, chosen, reset_moment(built, chosen, seconds=seconds, seed=seed)))
    if len(pictures) == 1:
        scenario_picture(pictures[0], out, edges=edges)
    else:
        scenario_sheet(pictures, out, edges=edges)
    typer.echo(f"wrote {out}")


@app.command()
def run(
    scenario: Name,
    traffic: Traffic = None,
    seconds: Annotated[float, typer.Option(help="Simulated time (s).", min=0.1, max=DAY)] = 60.0,
    seed: Seed = 42,
    out: Annotated[
        Path | None, typer.Option(help="Image file of the last step to write.", show_default=False)
    ] = None,
) -> None:
    """Run the traffic of a scenario, without agents."""
    from rich.progress import track

    from smarts.envision.scenario_picture import scenario_picture
    from smarts.sim.moments import Moment
    from smarts.sim.traffic_run import traffic_run
    from smarts.sstudio.build import build_scenario

    if out is not None:
        _check_picture(out)
    built = build_scenario(scenario)
    chosen = _traffic_of(built, traffic)
    typer.echo(f"{built.name}, {chosen or 'no traffic'}, seed {seed}")
    speed_sum, vehicle_steps, steps, most, stepping = 0.0, 0, round(seconds / 0.1), 0, 0.0
    with traffic_run(built, chosen, seed=seed) as traffic_now:
        run_steps = traffic_now.steps(seconds)
        for _ in track(range(steps), description="simulating"):
            begin = time.perf_counter()
            states = next(run_steps)
            stepping += time.perf_counter() - begin
            present = int(states.alive.sum())
            speed_sum += float(states.speed.sum())
            vehicle_steps += present
            most = max(most, present)
    typer.echo(
        f"{steps} steps of 0.1 s; {vehicle_steps / steps:.1f} vehicles on average, {most} at most; "
        f"mean speed {speed_sum / max(vehicle_steps, 1):.1f} m/s"
        + (f"; {seconds / stepping:,.0f} simulated seconds a second" if most else "; no traffic")
    )
    if out is not None:
        scenario_picture((built, chosen, Moment(traffic_now.states)), out)
        typer.echo(f"wrote {out}")


def _agent_notes(built: BuiltScenario) -> list[str]:
    """Return notes on the agents that a scenario asks for; imported here, as most ask for none.

    Raises:
        UnknownNameError: There is no such agent.
    """
    if not (built.scenario.bubbles or built.scenario.social_agent_missions):
        return []
    from smarts.env.casting import check_locators

    return check_locators(built)


def _held_out(built: BuiltScenario) -> str:
    return f"held-out variations {', '.join(built.held_out)}" if built.held_out else "no held-out variations"


def _chosen(scenarios: list[str] | None, everything: bool) -> list[str]:
    from smarts.sstudio.locating import suite

    if everything:
        check_effect("the whole suite", {"SCENARIO": scenarios})
        return list(suite())
    if not scenarios:
        raise SmartsError("no scenario is named", remedy=f"name some of {', '.join(suite())}, or give --all")
    return scenarios


def _traffic_of(built: BuiltScenario, wanted: str | None) -> str | None:
    """Return the wanted variation, by default the last, which in the suite has social vehicles."""
    if wanted is not None:
        built.traffic_files(wanted)
        return wanted
    return next(reversed(built.traffic), None)


def _check_picture(out: Path) -> None:
    """Raise if the image cannot be written, before the work is done."""
    if out.suffix.lower() not in FORMATS:
        raise SmartsError(
            f"unknown image format {out.suffix!r}", place=str(out), remedy=f"use {', '.join(FORMATS)}"
        )
