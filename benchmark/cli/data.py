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
