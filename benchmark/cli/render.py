"""`smarts-bench render`: recorded episodes as pictures and films."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from smarts.errors import SmartsError

if TYPE_CHECKING:
    from smarts.sim.episode_files import RecordedEpisode

PICTURES_PER_SECOND = 10
"""Of a film, unless told otherwise."""
END_SHOWN = 2.0
"""How much longer a film shows its last picture [s]."""


def render(
    episode: Annotated[Path, typer.Argument(help="Folder of a recorded episode.", show_default=False)],
    out: Annotated[
        Path,
        typer.Option(help="File to write, its folder too; the suffix chooses: .gif, .mp4 (by ffmpeg), .png."),
    ] = Path("episode.gif"),
    at: Annotated[
        float | None, typer.Option(help="Moment of a .png (s); by default the last.", show_default=False)
    ] = None,
    begin: Annotated[
        float | None, typer.Option(help="Begin of a film (s); by default the first.", show_default=False)
    ] = None,
    end: Annotated[
        float | None, typer.Option(help="End of a film (s); by default the last.", show_default=False)
    ] = None,
    every: Annotated[
        int | None,
        typer.Option(
            help="Steps from one picture of a film to the next; by default so many that it has 10 a second.",
            show_default=False,
            min=1,
            max=10**9,
        ),
    ] = None,
    speed: Annotated[
        float | None,
        typer.Option(help="Times as fast as it was; by default as it was.", show_default=False, min=0.01),
    ] = None,
    width: Annotated[int, typer.Option(help="Of the picture (pixels).", min=100, max=4000)] = 900,
) -> None:
    """Draw a recorded episode from above; no display is needed."""
    from smarts.envision.animation import STILL, check_format, write_moving, write_still
    from smarts.envision.episode_picture import EpisodePicture

    check_format(out)
    is_still = out.suffix.lower() in STILL
    film = {"--begin": begin, "--end": end, "--every": every, "--speed": speed}
    _check_options(out, {"--at": at} if not is_still else film)
    speed = 1.0 if speed is None else speed
    if not math.isfinite(speed):
        raise SmartsError(f"the speed is {speed:g}", place="--speed", remedy="give a number from 0.01")
    picture = EpisodePicture(_open(episode), pixels=width)
    every = max(1, round(speed / (PICTURES_PER_SECOND * picture.dt))) if every is None else every
    if is_still:
        last = picture.steps if at is None else _step_at(at, picture.dt, picture.steps, "--at")
        write_still(picture.image(last), out)
        typer.echo(f"{out}: {last * picture.dt:.1f} s")
        return
    begin = 0.0 if begin is None else begin
    first = _step_at(begin, picture.dt, picture.steps, "--begin")
    last = picture.steps if end is None else _step_at(end, picture.dt, picture.steps, "--end")
    if last < first:
        raise SmartsError(
            f"nothing lies between {begin:g} s and {last * picture.dt:g} s", place="--begin, --end"
        )
    steps = [*range(first, last, every), last]
    seconds = every * picture.dt / speed
    # The last one stays, since it shows how all agents ended.
    held = [last] * round(END_SHOWN / seconds)
    write_moving(picture.images([*steps, *held]), out, seconds)
    typer.echo(f"{out}: {len(steps)} pictures, {first * picture.dt:.1f} to {last * picture.dt:.1f} s")


def _open(folder: Path) -> RecordedEpisode:
    """Return an episode; of a folder of several, say which there are."""
    from smarts.sim.episode_files import RecordedEpisode, episodes_in

    inside = episodes_in(folder) if folder.is_dir() else []
    if inside:
        names = ", ".join(path.name for path in inside[:5])
        raise SmartsError(
            "this is a folder of episodes",
            place=str(folder),
            remedy=f"name one of them: {names}{', ...' if len(inside) > 5 else ''}",
        )
    return RecordedEpisode(folder)


def _check_options(out: Path, without_effect: Mapping[str, float | None]) -> None:
    given = [name for name, value in without_effect.items() if value is not None]
    if given:
        raise SmartsError(
            f"{', '.join(given)} {'say' if len(given) > 1 else 'says'} nothing of a {out.suffix}",
            place=str(out),
            remedy="leave it out: a .png is of one moment (--at), films go from --begin to --end",
        )


def _step_at(time: float, dt: float, steps: int, option: str) -> int:
    step = round(time / dt) if math.isfinite(time) else -1
    if not 0 <= step <= steps:
        raise SmartsError(
            f"the episode has no {time:g} s", place=option, remedy=f"it goes from 0 to {steps * dt:g} s"
        )
    return step
