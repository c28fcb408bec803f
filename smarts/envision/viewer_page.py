"""The built page: served, or as a file with episodes inside."""

from __future__ import annotations

import base64
import hashlib
import html
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

PAGE = Path(__file__).parent / "viewer.html"
_PLACE = "<!--EPISODE-->"
_INLINE = re.compile(r"<(script|style)\b([^>]*)>(.*?)</\1>", re.DOTALL | re.IGNORECASE)
_LOADS_NOTHING = (
    "default-src 'none'; base-uri 'none'; object-src 'none'; form-action 'none'; img-src 'self' blob: data:"
)


@dataclass(frozen=True)
class Embedded:
    """An episode inside a page."""

    id: str
    label: str
    data: bytes
    """The compact episode."""
    why: str = ""
    """Why it is shown, as "best"."""


@cache
def viewer_page() -> str:
    """Return the page."""
    return PAGE.read_text(encoding="utf-8")


def policy_of(page: str) -> str:
    """Return the page's content security policy: nothing runs but the code and the style that were built."""
    hashes: dict[str, list[str]] = {"script": [], "style": []}
    for kind, attributes, text in _INLINE.findall(page):
        if "application/octet-stream" not in attributes:
            digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
            hashes[kind.lower()].append(f"'sha256-{digest}'")
    sources = [f"{kind}-src {' '.join(found)}" for kind, found in hashes.items() if found]
    return "; ".join([_LOADS_NOTHING, *sources])


def page_with(episodes: Sequence[Embedded], page: str | None = None) -> str:
    """Return the page with episodes inside, which needs neither server nor network."""
    page = viewer_page() if page is None else page
    scripts = "".join(
        f'<script type="application/octet-stream" data-id="{html.escape(each.id)}" '
        f'data-label="{html.escape(each.label)}" data-why="{html.escape(each.why)}">'
        f"{base64.b64encode(each.data).decode()}</script>"
        for each in episodes
    )
    head = f'<meta http-equiv="Content-Security-Policy" content="{html.escape(policy_of(page))}">'
    before, _, behind = page.partition(_PLACE)
    return re.sub(r"<head[^>]*>", lambda found: found[0] + head, before, count=1) + scripts + behind
