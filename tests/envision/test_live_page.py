"""Simulations that run in another process, shown by the server in real Chromium."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from playwright.sync_api import Page, expect

from tests.envision.pages import ROOT
from tests.viewers import serving

pytestmark = pytest.mark.browser

STARTED = 180_000
"""Time for a simulation to start and compile its kernels [ms]."""


@contextmanager
def running(address: str) -> Iterator[None]:
    """Run two simulations in a process of their own."""
    process = subprocess.Popen([sys.executable, "-m", "tests.envision.live_run", address], cwd=ROOT)
    try:
        yield
    finally:
        process.kill()
        process.wait()


NOW = "parseFloat(document.querySelector('.time').textContent)"
"""The time of playback [s]. Episodes of `live_run` end after 1 s to 12 s, and it begins again."""


def wait_for_time(page: Page, more: float = 0.0) -> None:
    """Wait until playback has moved on by so much [s], over the ends of episodes."""
    page.evaluate(f"() => {{ window.shown = {NOW}; window.moved = 0; }}")
    page.wait_for_function(
        f"more => {{ const now = {NOW}; window.moved += Math.max(0, now - window.shown) || 0;"
        " window.shown = now; return window.moved > more; }",
        arg=more,
        timeout=STARTED,
    )


def test_what_runs_appears_moves_and_can_be_joined_late(open_page):
    with serving(page="", live=True) as server:
        page = open_page(url=server.url)
        expect(page.locator(".live-state")).to_have_text("live")
        with running(f"127.0.0.1:{server.port}"):
            expect(page.locator(".cell")).to_have_count(2, timeout=STARTED)
            expect(page.locator(".live")).to_be_visible()
            wait_for_time(page, 1.0)
            late = open_page(url=server.url)
            expect(late.locator(".cell")).to_have_count(2)
            wait_for_time(late, 1.0)
            expect(late.locator(".chip")).to_have_count(4)
            # What the chosen agent's policy gets.
            expect(late.locator(".sight")).to_contain_text("observation")
        expect(page.locator(".live-state")).to_have_text("live")
