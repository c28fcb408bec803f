"""The page and simulations whose messages are made by hand: episodes that end, and the past of them."""

import time

import pytest
from playwright.sync_api import expect

from tests.unit.envision.test_live_stream import begin, frame, send, the_map
from tests.viewers import publisher, serving

pytestmark = pytest.mark.browser

NOW = "parseFloat(document.querySelector('.time').textContent)"


def play(connection, steps, serial, pause=0.02):
    """Send frames of some steps in about their time."""
    for step in steps:
        send(connection, frame(step, serial=serial))
        time.sleep(pause)


@pytest.mark.nightly
def test_a_simulation_that_dies_is_said_to_have_ended(open_page):
    gone = "the simulation's process has gone"
    with serving(page="", live=True) as server:
        page = open_page(url=server.url)
        with publisher(server) as simulation:
            send(simulation, the_map(), begin(serial=1))
            expect(page.locator(".cell")).to_have_count(1)
            play(simulation, range(10), serial=1)
            expect(page.get_by_role("button", name="live", exact=True)).to_be_visible()
        expect(page.locator(".top small")).to_contain_text(gone)
        expect(page.locator(".toast")).to_contain_text(gone)
        expect(page.locator(".transport .live")).to_have_text("ended")
        page.keyboard.press("e")
        expect(page.locator(".row .badge[data-tone='warn']")).to_have_text("ended")
