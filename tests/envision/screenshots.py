"""Draws the pictures of the page that the documents show, and the film of the README.

python -m tests.envision.screenshots FOLDER [EPISODE]
"""

from __future__ import annotations

import io
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import PIL.Image
from playwright.sync_api import sync_playwright

from smarts.envision.episode_library import read_compact
from tests.envision.pages import CHROMIUM, FLAGS, episode, page_with

DESKTOP, WIDE, PHONE = (1280, 800), (1280, 720), (390, 844)


class Shot(NamedTuple):
    """A picture of the page."""

    name: str
    episodes: Sequence[str]
    fragment: str
    theme: str = "dark"
    size: tuple[int, int] = DESKTOP
    press: str = ""
    """A key that is pressed first."""


SHOTS = (
    Shot("envision_intersection", ["intersection"], "#t=15.2&cam=follow&agent=agent-0", "light"),
    Shot("envision_bubble", ["bubbles"], "#t=11.2&cam=free&agent=agent-0&at=180,140,270,2.2,0.9"),
    Shot(
        "envision_side_by_side",
        ["keep_lane", "gap_acceptance"],
        "#e=0,1&t=3.7&cam=follow&agent=agent-0",
        "light",
        WIDE,
    ),
    Shot("envision_observation", ["observed"], "#t=2.5&cam=follow&agent=agent-0", size=WIDE),
    Shot("envision_phone", ["intersection"], "#t=15.2&cam=follow&agent=agent-0", size=PHONE, press="p"),
)


FILM, SECONDS, PAUSE = (640, 400), np.arange(0.5, 22.0, 0.4), 200
"""Size of the film, times of its frames [s], and for how long each is shown [ms]: at twice the speed."""
COLOURS = 96
HIDDEN = ".legend, .labels { display: none }"
VIEWPOINT = "cam=free&agent=agent-0&at=174,154,95,1.99,0.8"
DRAWN = "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"


def film(file: Path, data: bytes) -> None:
    """Write a .gif of the page's scene, through which an episode runs."""
    width, height = FILM
    frames = []
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as pages:
        browser = playwright.chromium.launch(executable_path=shutil.which(CHROMIUM), args=FLAGS)
        page = browser.new_page(
            viewport={"width": width, "height": height}, color_scheme="light", device_scale_factor=2
        )
        source = Path(pages) / "film.html"
        source.write_text(page_with([data]))
        page.goto(f"{source.as_uri()}#t={SECONDS[0]}&{VIEWPOINT}")
        page.wait_for_selector(".app[data-ready]")
        # The scene alone, over the whole window.
        page.add_style_tag(content=f".stage {{ position: fixed !important; inset: 0; z-index: 9 }} {HIDDEN}")
        page.wait_for_timeout(1500)
        for seconds in SECONDS:
            page.evaluate(f"location.hash = '#t={seconds:.1f}&{VIEWPOINT}'")
            page.evaluate(DRAWN)
            drawn = PIL.Image.open(io.BytesIO(page.screenshot())).convert("RGB")
            frames.append(drawn.resize(FILM, PIL.Image.Resampling.LANCZOS))
        browser.close()
    palette = frames[len(frames) // 2].quantize(COLOURS, dither=PIL.Image.Dither.NONE)
    first, *others = (each.quantize(palette=palette, dither=PIL.Image.Dither.NONE) for each in frames)
    first.save(file, save_all=True, append_images=others, duration=PAUSE, loop=0, optimize=True)


def draw(folder: Path, shots: Sequence[Shot] = SHOTS) -> None:
    """Write a .png for each picture."""
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as pages:
        browser = playwright.chromium.launch(executable_path=shutil.which(CHROMIUM), args=FLAGS)
        for shot in shots:
            width, height = shot.size
            file = Path(pages) / f"{shot.name}.html"
            file.write_text(page_with([episode(name) for name in shot.episodes]))
            page = browser.new_page(
                viewport={"width": width, "height": height},
                color_scheme="dark" if shot.theme == "dark" else "light",
                device_scale_factor=2,
            )
            page.goto(file.as_uri() + shot.fragment)
            page.wait_for_selector(".app[data-ready]")
            if shot.press:
                page.keyboard.press(shot.press)
            page.wait_for_timeout(1500)
            drawn = PIL.Image.open(io.BytesIO(page.screenshot())).convert("RGB")
            # Drawn at twice the size, since software draws no smooth edges.
            drawn.resize(shot.size, PIL.Image.Resampling.LANCZOS).save(
                folder / f"{shot.name}.png", optimize=True
            )
            page.close()
        browser.close()


if __name__ == "__main__":
    draw(Path(sys.argv[1]))
    for path in sys.argv[2:]:
        film(Path(sys.argv[1]) / "driving.gif", read_compact(Path(path)))
