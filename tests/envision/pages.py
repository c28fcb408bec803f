"""Pages with compact episodes inside, and episodes that differ from recorded ones."""

import base64
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from smarts.stream.container import framed
from tests.compact_reading import messages_in

CHROMIUM = "chromium"
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
ROOT = Path(__file__).resolve().parents[2]
VIEWER = ROOT / "smarts/envision/viewer.html"
FIXTURES = ROOT / "tests/data/envision"
PLACE = "<!--EPISODE-->"


def episode(name: str) -> bytes:
    """Return a compact episode of tests/data."""
    return (FIXTURES / f"{name}.smarts").read_bytes()


def page_with(episodes: Sequence[bytes]) -> str:
    """Return the built page with episodes inside; their ids are 0, 1, ..."""
    scripts = "".join(
        f'<script type="application/octet-stream" data-id="{i}" data-label="episode {i}">'
        f"{base64.b64encode(data).decode()}</script>"
        for i, data in enumerate(episodes)
    )
    return VIEWER.read_text().replace(PLACE, scripts)


def changed(data: bytes, change: Callable[[dict[str, Any]], None]) -> bytes:
    """Return a compact episode, each of its messages changed in place."""
    messages = list(messages_in(data))
    for message in messages:
        change(message)
    return b"".join(framed(messages))
