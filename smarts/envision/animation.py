"""Writes images and animations to files."""

from __future__ import annotations

import contextlib
import shutil
import subprocess
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import IO, cast

import numpy as np
import PIL.Image
from numpy.typing import NDArray

from smarts.envision.whole_files import PARTIAL, written_whole
from smarts.errors import SmartsError

Image = NDArray[np.uint8]

MOVING = (".gif", ".mp4")
STILL = (".png",)
LONGEST_SHOWN = 600.0
"""Maximum duration of a frame [s]; the .gif format allows 655 s."""


def check_format(out: Path) -> None:
    """Check that the format of a file can be written.

    Raises:
        SmartsError: The suffix is unknown, or ffmpeg is missing for a .mp4.
    """
    suffix = out.suffix.lower()
    if suffix not in MOVING + STILL:
        raise SmartsError(
            f"there is no picture format '{out.suffix}'",
            place=str(out),
            remedy=f"end the name with one of {', '.join(MOVING + STILL)}",
        )
    if suffix == ".mp4" and shutil.which("ffmpeg") is None:
        raise SmartsError(
            "the program ffmpeg, which writes .mp4, was not found",
            place=str(out),
            remedy="install ffmpeg, or write a .gif",
        )


def write_still(image: Image, out: Path) -> None:
    """Write an image."""
    with written_whole(out) as partial:
        PIL.Image.fromarray(image).save(partial)


def write_moving(images: Iterable[Image], out: Path, seconds: float) -> None:
    """Write an animation; frames are consumed one by one.

    Args:
        images: The frames, all of the same even width and height.
        out: The file; its suffix is one of `MOVING`.
        seconds: Duration of each frame, clipped to `LONGEST_SHOWN` [s].

    Raises:
        SmartsError: ffmpeg failed; the error holds its message.
    """
    write = _write_gif if out.suffix.lower() == ".gif" else _write_mp4
    with written_whole(out) as partial:
        write(iter(images), partial, min(seconds, LONGEST_SHOWN))


def _write_gif(images: Iterator[Image], out: Path, seconds: float) -> None:
    first = PIL.Image.fromarray(next(images)).quantize(255, dither=PIL.Image.Dither.NONE)

    def others() -> Iterator[PIL.Image.Image]:
        for image in images:
            # One palette for all frames, since colours would flicker between different palettes.
            yield PIL.Image.fromarray(image).quantize(palette=first, dither=PIL.Image.Dither.NONE)

    # The format's unit is 10 ms, and players slow down frames shorter than 20 ms.
    duration = max(20, 10 * round(100 * seconds))
    first.save(out, save_all=True, append_images=others(), duration=duration, loop=0, optimize=False)


def _write_mp4(images: Iterator[Image], out: Path, seconds: float) -> None:
    first = next(images)
    size = f"{first.shape[1]}x{first.shape[0]}"
    command = ["ffmpeg", "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", size]
    command += ["-r", f"{1 / seconds:g}", "-i", "-", "-pix_fmt", "yuv420p", str(out)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        feed = cast("IO[bytes]", process.stdin)
        # If ffmpeg exits early, its message is read below.
        with contextlib.suppress(BrokenPipeError):
            feed.write(first.tobytes())
            for image in images:
                feed.write(image.tobytes())
        _, message = process.communicate()
    if process.returncode:
        raise SmartsError(
            f"ffmpeg failed: {message.decode(errors='replace').strip()}",
            place=str(out.name.removeprefix(PARTIAL)),
            remedy="write a .gif instead",
        )
