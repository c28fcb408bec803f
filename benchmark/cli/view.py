"""`smarts-bench view`: episodes in a browser, or as a page in one file."""

from __future__ import annotations

import os
import sys
import threading
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from benchmark.cli.choices import check_effect
from smarts.errors import SmartsError

if TYPE_CHECKING:
    from smarts.envision.episode_library import EpisodeLibrary


def view(
    paths: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="RUN_OR_EPISODE...",
            help="Folders of runs or of recorded episodes, or single episodes.",
            show_default=False,
        ),
    ] = None,
    html: Annotated[
        Path | None,
        typer.Option(
            help="Write a page with the episodes inside, which needs no server.", show_default=False
        ),
    ] = None,
    live: Annotated[
        bool, typer.Option("--live", help="Show simulations that run with SMARTS_ENVISION=host:port.")
    ] = False,
    port: Annotated[int, typer.Option(help="0: any that is free.", min=0, max=65535)] = 8081,
    browser: Annotated[bool, typer.Option(help="Open a browser, where there is a display.")] = True,
) -> None:
    """Show recorded episodes and running simulations in a browser."""
    if not paths and not live:
        raise SmartsError(
            "no episode is given",
            place="view",
            remedy="name the folder of a run or of recorded episodes, or one episode, or give --live",
        )
    if html is not None:
        check_effect("a page in a file", {"--live": live})
        _write(paths or [], html)
        return
    from smarts.envision.episode_library import EpisodeLibrary
    from smarts.envision.server import ViewServer

    library = EpisodeLibrary(paths) if paths else None
    server = ViewServer(library, live=live, port=port)
    count = len(library.entries(0)) if library else 0
    episodes = f"{count} {'episode' if count == 1 else 'episodes'}" if library else ""
    shown = " and ".join(part for part in (episodes, "running simulations" if live else "") if part)
    typer.echo(f"{shown} at {server.url} (Ctrl-C ends)")
    if browser and _has_browser():
        # In a thread, since some browsers return when they are closed. The server's port is open already.
        threading.Thread(target=webbrowser.open, args=(server.url,), daemon=True).start()
    server.run()


def _has_browser() -> bool:
    """Return whether a browser has a window to open, or the user names one."""
    names = ("BROWSER", "DISPLAY", "WAYLAND_DISPLAY")
    return sys.platform != "linux" or any(os.environ.get(name) for name in names)


def _write(paths: list[Path], html: Path) -> None:
    """Write episodes into a page, and say how large it is."""
    from smarts.envision.episode_library import EpisodeLibrary
    from smarts.envision.viewer_page import Embedded, page_with
    from smarts.whole_files import written_whole

    library = EpisodeLibrary(paths)
    entries = library.entries()
    if len(entries) > len(paths):
        _write_notable(library, html)
        return
    shown = [(each, library.compact(each.id)) for each in entries]
    content = page_with([Embedded(each.id, each.label, data) for each, data in shown if data]).encode()
    with written_whole(html) as partial:
        partial.write_bytes(content)
    typer.echo(f"{html}: {len(content) / 1e6:.2f} MB")


def _write_notable(library: EpisodeLibrary, html: Path) -> None:
    """Write the best, the worst, and one of each further kind of failure of many episodes."""
    from smarts.envision.notable_episodes import write_notable

    shown, left_out = write_notable(library, html)
    for notable in shown:
        typer.echo(f"{html}: {notable.label}")
    for entry, why in left_out:
        typer.echo(f"{entry.run}/{entry.label} is left out: {why}", err=True)
