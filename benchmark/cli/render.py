"""`smarts-bench render`: recorded episodes as pictures and films."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from benchmark.cli.choices import check_effect
from smarts.errors import SmartsError

if TYPE_CHECKING:
    from smarts.sim.episode_files import RecordedEpisode

PICTURES_PER_SECOND = 10
"""Default number of pictures per second of an animation."""
END_SHOWN = 2.0
"""Extra time for the last frame of an animation [s]."""


def render(
    episode: Annotated[
        Path, typer.Argument(metavar="EPISODE", help="Folder of a recorded episode.", show_default=False)
    ],
    out: Annotated[
        Path,
        typer.Option(
            help="File to write; the suffix selects the format (.mp4, .gif, .png). Missing folders are made."
        ),
    ] = Path("episode.gif"),
    at: Annotated[
        float | None, typer.Option(help="Time of a .png (s).", show_default="the last step")
    ] = None,
    begin: Annotated[
        float | None, typer.Option(help="First time of an animation (s).", show_default="the first step")
    ] = None,
    end: Annotated[
        float | None, typer.Option(help="Last time of an animation (s).", show_default="the last step")
    ] = None,
    every: Annotated[
        int | None,
        typer.Option(
            help="Simulation steps from one frame of an animation to the next.",
            show_default="10 frames a second",
            min=1,
            max=10**9,
        ),
    ] = None,
    width: Annotated[int, typer.Option(help="Image width (pixels).", min=100, max=4000)] = 900,
) -> None:
    """Draw a recorded episode from above, as image or animation."""
    from smarts.envision.animation import STILL, check_format, write_moving, write_still
    from smarts.envision.episode_picture import EpisodePicture

    check_format(out)
    is_still = out.suffix.lower() in STILL
    film = {"--begin": begin, "--end": end, "--every": every}
    check_effect(f"a {out.suffix}", {"--at": at} if not is_still else film)
    picture = EpisodePicture(_open(episode), pixels=width)
    every = max(1, round(1 / (PICTURES_PER_SECOND * picture.dt))) if every is None else every
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
    seconds = every * picture.dt
    # The last frame stays, since it shows the outcomes.
    held = [last] * round(END_SHOWN / seconds)
    frames = write_moving(map(picture.image, [*steps, *held]), out, seconds)
    typer.echo(f"{out}: {frames} frames, {first * picture.dt:.1f} to {last * picture.dt:.1f} s")


def _open(folder: Path) -> RecordedEpisode:
    """Return an episode; raise for a folder of several, with their names."""
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


def _step_at(time: float, dt: float, steps: int, option: str) -> int:
    step = round(time / dt)
    if not 0 <= step <= steps:
        raise SmartsError(
            f"the episode has no {time:g} s", place=option, remedy=f"it goes from 0 to {steps * dt:g} s"
        )
    return step
