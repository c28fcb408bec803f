"""`smarts-bench zoo` and `smarts-bench export`: policies of road users."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from benchmark.cli.experiments import Import
from benchmark.cli.lists import aligned

app = typer.Typer(help="List, describe and test policies of road users.", no_args_is_help=True)

Locator = Annotated[
    str,
    typer.Argument(
        metavar="LOCATOR", help="A name such as idm-v0, or my_module:my-agent-v0.", show_default=False
    ),
]
Options = Annotated[
    list[str] | None,
    typer.Option("--set", help="Option of the agent, e.g. --set tau=2. Repeatable.", metavar="KEY=VALUE"),
]
COLUMNS = ("locator", "level", "author", "provenance")


@app.command("list")
def list_agents() -> None:
    """List the agents that are known: of this project and of installed packages."""
    from smarts.zoo import entries

    rows = [COLUMNS, *((e.locator, e.m_level, e.author, e.provenance) for e in entries())]
    typer.echo("\n".join(aligned(rows)))


@app.command()
def describe(locator: Locator, import_: Import = None) -> None:
    """Print what an agent does, how it sees and acts, and its options."""
    from smarts.registry import import_own
    from smarts.zoo import find_entry

    import_own(import_ or ())
    entry = find_entry(locator)
    typer.echo(f"{locator}: {entry.description()}")
    about = {
        "author": entry.author,
        "M-level": entry.m_level,
        "provenance": entry.provenance,
        "licence": entry.licence,
    }
    for name, text in about.items():
        typer.echo(f"  {name}: {text or 'not said'}")
    for name, default in entry.options().items():
        typer.echo(f"  option {name}: {_shown(default)}")


@app.command("test")
def check_agent(
    locator: Locator,
    set_: Options = None,
    scenario: Annotated[str, typer.Option(help="Scenario name or folder to drive in.")] = "loop",
    import_: Import = None,
) -> None:
    """Test whether an agent keeps the contract of the zoo."""
    from benchmark.running.zoo_contract import check_entry
    from smarts.registry import import_own

    import_own(import_ or ())
    for line in check_entry(locator, options_of(set_ or []), scenario=scenario):
        typer.echo(f"ok  {line}")


@app.command()
def kit(out: Annotated[Path, typer.Option(help="Folder of the wheel.")] = Path()) -> None:
    """Write the wheel of the agents' kit, for another machine or environment."""
    from benchmark.results.files import named_failures
    from smarts.zoo.kit_wheel import build_wheel

    with named_failures(out):
        out.mkdir(parents=True, exist_ok=True)
        wheel = build_wheel(out)
    typer.echo(f"wrote {wheel}")


def export(
    run: Annotated[
        Path,
        typer.Argument(metavar="RUN", help="A run's folder, results/NAME/.../seed_1.", show_default=False),
    ],
    name: Annotated[
        str, typer.Option("--zoo", help="Name of the agent: NAME becomes NAME-v0.", show_default=False)
    ],
    out: Annotated[Path, typer.Option(help="Parent of the new folder.")] = Path(),
    checkpoint: Annotated[
        Literal["best", "last"], typer.Option(help="The best in validation, or the last.")
    ] = "best",
    import_: Import = None,
) -> None:
    """Export the policy of a run as an agent of the zoo: a folder with weights and a plain module."""
    from benchmark.running.exporting import export_policy

    folder = export_policy(run, name, out, checkpoint=checkpoint, imports=import_ or ())
    typer.echo(f"wrote {folder}")
    typer.echo(f"its locator, with --import {folder} or imports: [{folder}]: {folder.name}:{name}-v0")


def serve(
    locator: Locator,
    address: Annotated[
        str, typer.Option(metavar="HOST:PORT", help="Where simulators find it; port 0: any free one.")
    ],
    set_: Options = None,
    import_: Import = None,
) -> None:
    """Serve an agent to simulators on this and other machines, until the command is interrupted."""
    from smarts.registry import import_own
    from smarts.zoo.serving import serve as serve_agent

    import_own(import_ or ())
    serve_agent(locator, options_of(set_ or []), address, ready=lambda place: typer.echo(f"serving {place}"))


def options_of(given: list[str]) -> dict[str, Any]:
    """Return options by name, from texts "KEY=VALUE" whose values are YAML.

    Raises:
        ConfigError: A text has another form.
    """
    from smarts.config.sources import read_override

    options: dict[str, Any] = {}
    for text in given:
        name, _, value = text.partition("=")
        # An asterisk means all agents, and is no YAML.
        options |= {name: value} if value == "*" else read_override(text).values
    return options


def _shown(default: Any) -> str:
    import inspect

    return "needed" if default is inspect.Parameter.empty else repr(default)
