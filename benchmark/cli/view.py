"""`smarts-bench view`: episodes in a browser, as a page in one file, or as compact files."""

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
    from smarts.envision.viewer_page import Embedded


def view(
    paths: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="RUN_OR_EPISODE...",
            help="Folders of runs or of recorded episodes, single episodes, or .smarts files.",
            show_default=False,
        ),
    ] = None,
    html: Annotated[
        Path | None,
        typer.Option(
            help="Write a page with the episodes inside, which needs no server.", show_default=False
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Write one episode as a compact file (.smarts).", show_default=False)
    ] = None,
    begin: Annotated[
        float | None, typer.Option(help="First time of what is written (s).", show_default="the first step")
    ] = None,
    end: Annotated[
        float | None, typer.Option(help="Last time of what is written (s).", show_default="the last step")
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
    if html is not None or out is not None:
        check_effect("files of episodes", {"--live": live})
        _write(paths or [], html, out, begin, end)
        return
    check_effect("what is served", {"--begin": begin, "--end": end}, "leave it out, or give --html or --out")
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


def _write(
    paths: list[Path], html: Path | None, out: Path | None, begin: float | None, end: float | None
) -> None:
    """Write episodes into files, and say how large these are."""
    from smarts.envision.episode_library import EpisodeLibrary
    from smarts.envision.viewer_page import page_with
    from smarts.whole_files import written_whole

    if html is not None and out is None and begin is None and end is None:
        library = EpisodeLibrary(paths)
        if len(library.entries()) > len(paths):
            _write_notable(library, html)
            return
    if out is not None and len(paths) > 1:
        raise SmartsError(
            f"{len(paths)} episodes for one file", place=str(out), remedy="name one episode, or use --html"
        )
    episodes = [_embedded(path, begin, end) for path in paths]
    files: dict[Path, bytes] = {}
    if out is not None:
        files[out] = episodes[0].data
    if html is not None:
        files[html] = page_with(episodes).encode()
    for path, content in files.items():
        with written_whole(path) as partial:
            partial.write_bytes(content)
        typer.echo(f"{path}: {len(content) / 1e6:.2f} MB")


def _write_notable(library: EpisodeLibrary, html: Path) -> None:
    """Write the best, the worst, and one of each further kind of failure of many episodes."""
    from smarts.envision.notable_episodes import write_notable

    shown, left_out = write_notable(library, html)
    for notable in shown:
        typer.echo(f"{html}: {notable.label}")
    for entry, why in left_out:
        typer.echo(f"{entry.run}/{entry.label} is left out: {why}", err=True)


def _embedded(path: Path, begin: float | None, end: float | None) -> Embedded:
    """Return one episode, or a part of it; a folder may hold it."""
    from smarts.envision.episode_library import EpisodeLibrary, read_compact
    from smarts.envision.viewer_page import Embedded

    library = EpisodeLibrary([path])
    entry, *others = library.entries()
    if others:
        names = ", ".join(f"{each.run}/{each.label}" for each in [entry, *others][:5])
        raise SmartsError(
            f"this folder has {1 + len(others)} episodes",
            place=str(path),
            remedy=f"name one of them: {names}{', ...' if len(others) > 4 else ''}",
        )
    place = library.path(entry.id) or path
    if place.is_file():
        check_effect(f"the compact file {place}", {"--begin": begin, "--end": end})
    return Embedded(entry.id, entry.label, read_compact(place, begin, end))
