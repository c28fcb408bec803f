"""Draws the pictures of the page that the documents show: `python -m tests.envision.screenshots FOLDER`."""

from __future__ import annotations

import io
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import PIL.Image
from playwright.sync_api import sync_playwright

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
