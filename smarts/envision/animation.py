"""Writes images and animations to files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from fractions import Fraction
from itertools import chain
from pathlib import Path

import numpy as np
import PIL.Image
from numpy.typing import NDArray

from smarts.errors import SmartsError
from smarts.whole_files import written_whole

QUALITY = 20
"""The encoder's constant rate factor for films, from 0 (lossless) to 51."""
Image = NDArray[np.uint8]
"""Red, green, blue, shape (height, width, 3)."""

MOVING = (".gif", ".mp4")
STILL = (".png",)
SHORTEST_SHOWN = 0.02
"""Minimum duration of a frame of a .gif [s]: players slow down shorter ones."""


def check_format(out: Path) -> None:
    """Check that the format of a file can be written.

    Raises:
        SmartsError: The suffix is unknown.
    """
    if out.suffix.lower() not in MOVING + STILL:
        raise SmartsError(
            f"there is no picture format '{out.suffix}'",
            place=str(out),
            remedy=f"end the name with one of {', '.join(MOVING + STILL)}",
        )


def write_still(image: Image, out: Path) -> None:
    """Write an image."""
    with written_whole(out) as partial:
        PIL.Image.fromarray(image).save(partial)


def write_moving(images: Iterable[Image], out: Path, seconds: float) -> int:
    """Write an animation; frames are consumed one by one.

    Returns the number of frames in the file; a .gif holds equal frames that follow each other as one.

    Args:
        images: The frames, all of one size; an .mp4 lacks the last row or column of an odd number.
        out: The file; its suffix is one of `MOVING`.
        seconds: Duration of each frame [s].

    Raises:
        SmartsError: The file cannot be written.
    """
    write = _write_gif if out.suffix.lower() == ".gif" else _write_mp4
    with written_whole(out) as partial:
        return write(iter(images), partial, seconds)


def _write_gif(images: Iterator[Image], out: Path, seconds: float) -> int:
    seconds = max(seconds, SHORTEST_SHOWN)

    def timed(image: PIL.Image.Image, number: int) -> PIL.Image.Image:
        # The format's unit is 10 ms: what one frame loses, the next one gets.
        image.info["duration"] = 10 * (round(100 * seconds * (number + 1)) - round(100 * seconds * number))
        return image

    first = timed(PIL.Image.fromarray(next(images)).quantize(255, dither=PIL.Image.Dither.NONE), 0)

    def others() -> Iterator[PIL.Image.Image]:
        for number, image in enumerate(images, 1):
            # One palette for all frames, since colours would flicker between different palettes.
            frame = PIL.Image.fromarray(image).quantize(palette=first, dither=PIL.Image.Dither.NONE)
            yield timed(frame, number)

    first.save(out, save_all=True, append_images=others(), loop=0, optimize=False)
    with PIL.Image.open(out) as film:
        return getattr(film, "n_frames", 1)


def _write_mp4(images: Iterator[Image], out: Path, seconds: float) -> int:
    """Write H.264 by the encoder that comes with PyAV; return the number of frames."""
    # Only those who write films wait for it.
    import av
    from av.error import FFmpegError
    from av.video.stream import VideoStream

    # Colours have half the resolution: an odd row or column would have none.
    images = (image[: len(image) & ~1, : image.shape[1] & ~1] for image in images)
    first = next(images)
    frames = 0
    rate = Fraction(1 / seconds).limit_denominator(1000)
    try:
        with av.open(str(out), "w", format="mp4", options={"movflags": "+faststart"}) as container:
            stream = container.add_stream("libx264", rate=rate, options={"crf": str(QUALITY)})
            assert isinstance(stream, VideoStream)
            stream.height, stream.width = first.shape[:2]
            stream.pix_fmt = "yuv420p"
            for image in chain([first], images):
                whole = np.ascontiguousarray(image)
                container.mux(stream.encode(av.VideoFrame.from_ndarray(whole, format="rgb24")))
                frames += 1
            container.mux(stream.encode(None))
    except FFmpegError as error:
        raise SmartsError(
            f"the film cannot be encoded: {error.strerror}",
            place=out.name,
            remedy="check that there is room on the disk",
        ) from error
    return frames
