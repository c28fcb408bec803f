"""The page that shows episodes, in real Chromium."""

import io

import numpy as np
import PIL.Image
import PIL.ImageColor
import pytest
from playwright.sync_api import Page, expect

from tests.envision.conftest import PHONE
from tests.envision.pages import changed, episode

pytestmark = pytest.mark.browser

TOAST = ".toast[role=alert]"
"""Messages over the page, which hide after some seconds."""
HOSTILE = '<img src=x onerror="document.title=1"></script><b>bold</b>'


def picture(page: Page) -> np.ndarray:
    """Return the scene as it is on the screen, shape (height, width, 3)."""
    image = PIL.Image.open(io.BytesIO(page.locator(".stage").screenshot())).convert("RGB")
    return np.asarray(image).astype(int)


def part_like(image: np.ndarray, colour: tuple[int, int, int], within: int = 60) -> float:
    """Return the part of the picture that is near a colour."""
    return float((np.abs(image - np.array(colour)).sum(-1) < within).mean())


def time_of(page: Page) -> float:
    """Return the time of playback [s]."""
    return float(page.locator(".time").inner_text().split("/")[0])


def test_the_scene_has_roads_and_vehicles_of_each_owner(open_page):
    page = open_page(episode("bubbles"), fragment="#t=6")
    expect(page.locator("h1")).to_have_text("bubble_junction")
    image = picture(page)
    assert part_like(image, (37, 43, 53)) > 0.01
    assert part_like(image, (238, 63, 70)) > 1e-5
    assert part_like(image, (116, 184, 245)) > 1e-5
    names = ["ego", "social agent", "traffic", "fallback", "air-lock", "bubble"]
    expect(page.locator(".legend > span")).to_have_text(names)


def test_it_plays_stops_and_steps(open_page):
    page = open_page(episode("intersection"), fragment="#t=5")
    page.wait_for_timeout(300)
    assert time_of(page) == 5.0
    before = picture(page)
    page.keyboard.press(".")
    expect(page.locator(".time")).to_contain_text("5.1 /")
    page.keyboard.press(",")
    page.keyboard.press("Space")
    expect(page.get_by_role("button", name="Pause")).to_be_visible()
    page.wait_for_function("() => parseFloat(document.querySelector('.time').textContent) > 6")
    page.keyboard.press("Space")
    expect(page.get_by_role("button", name="Play", exact=True)).to_be_visible()
    assert (picture(page) != before).any()


@pytest.mark.nightly
def test_the_panel_follows_the_chosen_agent(open_page):
    page = open_page(episode("intersection"), fragment="#t=3")
    page.get_by_role("option", name="agent-2").click()
    expect(page.locator(".panel h2")).to_have_text("agent-2")
    expect(page.locator(".action")).to_contain_text("keep lane")
    assert float(page.locator(".big").inner_text()) >= 0
    assert page.locator(".chart").count() >= 2
    page.keyboard.press("a")
    expect(page.locator(".panel h2")).to_have_text("agent-3")


@pytest.mark.nightly
def test_a_link_and_a_reload_restore_the_view(open_page):
    page = open_page(episode("bubbles"), fragment="#e=0&t=12.4&speed=2&cam=free&agent=agent-0")
    page.wait_for_function("location.hash.includes('at=')")  # the camera has found what there is to see
    page.wait_for_timeout(1200)
    link = page.evaluate("location.hash")
    before = picture(page)
    page.reload()
    page.wait_for_selector(".app[data-ready]")
    page.wait_for_timeout(1200)
    assert page.evaluate("location.hash") == link
    assert "t=12.4" in link
    assert "cam=free" in link
    expect(page.get_by_role("button", name="Free")).to_have_attribute("aria-pressed", "true")
    assert page.get_by_label("speed", exact=True).input_value() == "2"
    assert np.abs(picture(page) - before).mean() < 2


def test_the_list_sorts_by_outcome_and_filters(open_page):
    def crash(message):
        if message.get("name") in ("agents", "outcomes"):
            outcomes = message["columns"]["outcome"]
            outcomes["d"] = bytes([1] * len(outcomes["d"]))

    page = open_page(
        episode("intersection"), changed(episode("bubbles"), crash), episode("bubbles"), fragment="#e=0"
    )
    page.keyboard.press("e")
    page.get_by_role("columnheader", name="outcomes").click()
    expect(page.locator(".row").first).to_contain_text("collision")
    page.get_by_role("columnheader", name="outcomes").click()
    expect(page.locator(".row").last).to_contain_text("collision")
    page.get_by_label("filter").fill("collision")
    assert page.locator(".row").count() == 1
    page.locator(".row .add").first.click()
    page.keyboard.press("Escape")
    expect(page.locator(".list")).not_to_be_visible()


@pytest.mark.nightly
def test_a_phone_shows_everything_without_scrolling(open_page):
    page = open_page(episode("bubbles"), fragment="#t=6", size=PHONE)
    width = page.evaluate("document.documentElement.scrollWidth")
    assert width <= PHONE[0]
    for name in ("Play", "One step", "To the next event", "Episodes", "Top", "Follow", "Panel of the agent"):
        box = page.get_by_role("button", name=name, exact=True).bounding_box()
        assert box
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= PHONE[0]
        assert box["y"] + box["height"] <= PHONE[1]
        assert box["height"] >= 28
    box = page.get_by_label("speed", exact=True).bounding_box()
    assert box
    assert box["x"] + box["width"] <= PHONE[0]
    page.get_by_role("button", name="Panel of the agent").tap()
    expect(page.locator(".panel h2")).to_be_visible()
    page.get_by_role("button", name="Episodes").tap()
    expect(page.locator(".row").first).to_be_visible()


@pytest.mark.nightly
def test_texts_of_an_episode_stay_texts(open_page):
    def rename(message):
        if message["type"] == "episode":
            message["facts"] |= {"scenario": HOSTILE, "traffic": HOSTILE}
        if message.get("name") == "agents":
            message["columns"]["name"] = [HOSTILE] * len(message["columns"]["name"])
        if message["type"] == "vehicles":
            message["name"] = [HOSTILE] * len(message["name"])
        if message["type"] == "end":
            message["remark"] = HOSTILE

    page = open_page(changed(episode("bubbles"), rename), fragment="#t=6")
    expect(page.locator("h1")).to_have_text(HOSTILE)
    page.keyboard.press("e")
    assert page.locator("img, b:text-is('bold')").count() == 0
    assert page.title().startswith(HOSTILE[:10])


@pytest.mark.nightly
def test_a_cut_episode_plays_up_to_the_cut(open_page):
    data = episode("intersection")
    page = open_page(data[: len(data) * 3 // 4], fragment="#t=1")
    expect(page.locator(TOAST)).to_contain_text("cut off")
    end = float(page.locator(".time").inner_text().split("/")[1].removesuffix("s"))
    assert 5 < end < 43
