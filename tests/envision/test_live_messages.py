"""The page and simulations whose messages are made by hand: episodes that end, and the past of them."""

import time

import pytest
from playwright.sync_api import expect

from smarts.stream.container import pack
from tests.unit.envision.test_live_stream import begin, frame, the_map
from tests.viewers import publisher, serving

pytestmark = pytest.mark.browser

HOSTILE = '<img src=x onerror="document.title=1"></script><b>bold</b>'
NOW = "parseFloat(document.querySelector('.time').textContent)"


def send(connection, *messages):
    for message in messages:
        connection.send(pack(message))


def play(connection, steps, serial, pause=0.02):
    """Send frames of some steps in about their time."""
    for step in steps:
        send(connection, frame(step, serial=serial))
        time.sleep(pause)


def end(serial):
    return {"type": "end", "is_complete": True, "remark": "", "source": "a", "serial": serial}


@pytest.mark.nightly
def test_episodes_that_ended_stay_in_the_list(open_page):
    with serving(page="", live=True) as server, publisher(server) as simulation:
        page = open_page(url=server.url)
        send(simulation, the_map(), begin(serial=1, scenario=HOSTILE))
        expect(page.locator(".cell")).to_have_count(1, timeout=20_000)
        play(simulation, range(60), serial=1)
        page.wait_for_function(f"() => {NOW} > 5")
        send(simulation, end(1), begin(serial=2, scenario=HOSTILE, episode=4))
        play(simulation, range(20), serial=2)
        page.wait_for_function(f"() => {NOW} < 3")
        page.keyboard.press("e")
        expect(page.locator(".row")).to_have_count(2)
        past = page.locator(".row").filter(has_text="episode 3")
        expect(past).to_contain_text("6 s")
        expect(past).to_contain_text("<img src=x")
        past.locator(".open").click()
        expect(page.locator(".time")).to_contain_text("/ 5.9 s")
        assert page.locator("img, b:text-is('bold')").count() == 0


@pytest.mark.nightly
def test_another_episode_waits_while_one_looks_at_the_past(open_page):
    with serving(page="", live=True) as server, publisher(server) as simulation:
        page = open_page(url=server.url)
        send(simulation, the_map(), begin(serial=1))
        expect(page.locator(".cell")).to_have_count(1, timeout=20_000)
        play(simulation, range(120), serial=1)
        page.wait_for_function(f"() => {NOW} > 11")
        page.keyboard.press("ArrowLeft")
        page.keyboard.press("ArrowLeft")
        page.keyboard.press("Space")
        # What keys do is drawn with the next picture.
        page.wait_for_function(f"() => {NOW} < 4")
        stopped = page.evaluate(NOW)
        send(simulation, end(1), begin(serial=2, episode=4))
        play(simulation, range(30), serial=2)
        assert page.evaluate(NOW) == stopped
        expect(page.locator(".time")).to_contain_text("/ 11.9 s")
        page.get_by_role("button", name="back to live").click()
        page.wait_for_function("() => document.querySelector('.time').textContent.endsWith('/ 2.9 s')")


@pytest.mark.nightly
def test_the_last_frame_and_the_end_are_shown_though_nothing_follows(open_page):
    with serving(page="", live=True) as server, publisher(server) as simulation:
        page = open_page(url=server.url)
        send(simulation, the_map(), begin(serial=1))
        expect(page.locator(".cell")).to_have_count(1, timeout=20_000)
        play(simulation, range(10), serial=1, pause=0)
        send(simulation, end(1))
        expect(page.locator(".time")).to_contain_text("/ 0.9 s")


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
