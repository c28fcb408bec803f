"""The page that shows episodes, in real Chromium."""

import io
import re

import numpy as np
import PIL.Image
import PIL.ImageColor
import pytest
from playwright.sync_api import Page, expect

from smarts.envision import viewer_page
from smarts.envision.viewer_page import Embedded
from smarts.stream.arrays import packed_array, unpacked_array
from smarts.stream.container import framed, messages_in
from tests.envision.conftest import PHONE
from tests.envision.pages import changed, episode, observing

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
def test_one_jumps_along_the_events(open_page):
    page = open_page(episode("intersection"), fragment="#t=0.0")
    marks = page.locator(".mark[data-tone=good]")
    assert marks.count() == 4
    marks.nth(1).click()
    label = marks.nth(1).get_attribute("aria-label")
    found = re.match(r"([\d.]+) s: (.+): goal", label or "")
    assert found
    expect(page.locator(".time")).to_contain_text(f"{found[1]} /")
    expect(page.locator(".panel h2")).to_have_text(found[2])
    expect(page.locator(".panel .title .badge")).to_have_text("goal")
    page.keyboard.press("]")
    page.wait_for_function(f"() => parseFloat(document.querySelector('.time').textContent) > {found[1]}")


def test_the_panel_follows_the_chosen_agent(open_page):
    page = open_page(episode("intersection"), fragment="#t=3")
    page.get_by_role("option", name="agent-2").click()
    expect(page.locator(".panel h2")).to_have_text("agent-2")
    expect(page.locator(".action")).to_contain_text("keep lane")
    assert float(page.locator(".big").inner_text()) >= 0
    assert page.locator(".chart").count() >= 2
    page.keyboard.press("a")
    expect(page.locator(".panel h2")).to_have_text("agent-3")


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


@pytest.mark.nightly
def test_the_camera_moves_by_pointer(open_page):
    page = open_page(episode("intersection"), fragment="#t=8&cam=free")
    page.wait_for_timeout(900)
    before = picture(page)
    page.mouse.move(400, 400)
    page.mouse.wheel(0, -400)
    page.mouse.down()
    page.mouse.move(480, 460, steps=4)
    page.mouse.up()
    page.wait_for_timeout(300)
    assert np.abs(picture(page) - before).mean() > 0.5


@pytest.mark.nightly
def test_nine_at_once_in_step_or_each_by_itself(open_page):
    episodes = [episode("intersection"), episode("bubbles")] * 4 + [episode("intersection")]
    page = open_page(*episodes, fragment=f"#e={','.join(map(str, range(9)))}&t=4")
    assert page.locator(".cell").count() == 9
    image = picture(page)
    height, width = image.shape[0] // 3, image.shape[1] // 3
    for row in range(3):
        for column in range(3):
            cell = image[row * height : (row + 1) * height, column * width : (column + 1) * width]
            assert len(np.unique(cell.reshape(-1, 3), axis=0)) > 50
    page.get_by_role("button", name="in step").click()
    page.keyboard.press("ArrowRight")
    expect(page.locator(".time")).to_contain_text("9.0 /")
    page.locator(".cell-name").nth(4).click()
    expect(page.locator(".time")).to_contain_text("4.0 /")
    page.get_by_role("button", name=re.compile("Show only")).nth(4).click()
    assert page.locator(".cell").count() == 1


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


IS_WHOLE = "e => e.scrollWidth <= e.clientWidth && e.scrollHeight <= e.clientHeight"


@pytest.mark.nightly
def test_the_pages_of_a_run_say_why_each_episode_is_shown(open_page, tmp_path):
    reasons = ["best", "worst", "off road, wrong way", "time out"]
    shown = [
        Embedded(str(i), f"seed42_world200000{i}_episode00000", episode(name), why)
        for i, (why, name) in enumerate(zip(reasons, ["intersection", "bubbles"] * 2, strict=True))
    ]
    file = tmp_path / "run.html"
    file.write_text(viewer_page.page_with(shown))
    page = open_page(url=file.as_uri(), fragment="#t=9", size=PHONE)
    names = page.locator(".cell-name")
    expect(names).to_have_text([re.compile(f"^{why} · ") for why in reasons])
    for name in names.all():
        assert name.evaluate(IS_WHOLE)
    page.keyboard.press("e")
    expect(page.locator(".row .why")).to_have_text(["worst", "time out", "best", "off road, wrong way"])
    for text in page.locator(".row small").all():
        assert text.evaluate(IS_WHOLE)


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


def test_a_cut_episode_plays_up_to_the_cut(open_page):
    data = episode("intersection")
    page = open_page(data[: len(data) * 3 // 4], fragment="#t=1")
    expect(page.locator(TOAST)).to_contain_text("cut off")
    end = float(page.locator(".time").inner_text().split("/")[1].removesuffix("s"))
    assert 5 < end < 43


def test_foreign_and_future_episodes_are_refused_with_a_reason(open_page):
    def age(message):
        if message["type"] == "episode":
            message["version"] = 99

    for data, reason in (
        (changed(episode("bubbles"), age), "version 99"),
        (b"PK\3\4 no episode", "not a compact episode"),
    ):
        page = open_page(data)
        expect(page.locator(TOAST)).to_contain_text(reason)


@pytest.mark.nightly
def test_lights_are_drawn_as_they_change(open_page):
    data = episode("intersection")
    lanes = next(message["lanes"] for message in messages_in(data) if message["type"] == "map")
    inside = np.flatnonzero(unpacked_array(lanes["junction"])).astype(np.int32)
    columns = {
        "step": np.repeat([0, 100], len(inside)).astype(np.int32),
        "lane": np.tile(inside, 2),
        "signal": np.repeat([1, 3], len(inside)).astype(np.int8),
    }
    packed = {name: packed_array(column) for name, column in columns.items()}
    table = {"type": "table", "name": "signals", "append": True, "columns": packed}

    def light(message):
        if message["type"] == "map":
            message["lanes"]["signal"] = message["lanes"]["junction"]

    messages = [*messages_in(changed(data, light))]
    messages.insert(2, table)
    lit = b"".join(framed(messages))
    parts = {}
    for t in (5, 15):
        page = open_page(lit, fragment=f"#t={t}&cam=top&at=174,154,60,1.571,0")
        page.wait_for_timeout(600)
        image = picture(page)
        parts[t] = part_like(image, (255, 77, 79)), part_like(image, (53, 208, 127))
    # Egos are red, too.
    assert parts[5][0] > parts[15][0] + 1e-3
    assert parts[15][1] > 2 * parts[5][1]
    assert parts[15][1] > 1e-4


def test_what_the_chosen_agent_observes_is_drawn(open_page):
    data = observing(episode("intersection"))
    page = open_page(data, fragment="#t=9&cam=follow&agent=agent-0")
    page.wait_for_timeout(1200)
    seen = picture(page)
    # Yellow paths, cyan points of the lidar.
    assert part_like(seen, (242, 225, 76)) > 1e-3
    assert part_like(seen, (94, 242, 255)) > 1e-3
    panel = page.locator(".sight")
    expect(panel).to_contain_text("2 paths of waypoints, 1 neighbour, 60 lidar points")
    expect(panel).to_contain_text("speed 7.25")
    assert panel.locator("canvas").count() == 2
    pixel = "c => [...c.getContext('2d').getImageData(%s, %s, 1, 1).data]"
    full, empty = (panel.locator("canvas").first.evaluate(pixel % place) for place in ((3, 3), (20, 20)))
    assert full[3] == 255
    assert empty[3] == 0
    page.keyboard.press("a")
    page.wait_for_timeout(1200)
    expect(panel).not_to_be_visible()
    assert part_like(picture(page), (94, 242, 255)) < 1e-4


@pytest.mark.nightly
def test_two_policies_on_the_same_test_episode_are_compared(open_page):
    def name(policy):
        def change(message):
            if message["type"] == "episode":
                message["facts"]["policy"] = policy

        return change

    data = episode("intersection")
    page = open_page(
        changed(data, name("<b>ippo</b>")),
        episode("bubbles"),
        changed(data, name("idm")),
        fragment="#e=1&clock=own",
    )
    page.keyboard.press("e")
    expect(page.locator(".row").filter(has_text="idm")).to_have_count(1)
    assert page.get_by_role("button", name="compare").count() == 2
    page.locator(".row").filter(has_text="idm").get_by_role("button", name="compare").click()
    expect(page.locator(".cell-name")).to_have_text(["intersection · idm", "intersection · <b>ippo</b>"])
    expect(page.get_by_role("button", name="in step")).to_be_visible()
    page.keyboard.press("Space")
    page.keyboard.press("End")
    page.wait_for_function("() => location.hash.includes('e=2,0&t=43.0')")


@pytest.mark.nightly
def test_a_damaged_episode_does_not_hide_the_others(open_page):
    page = open_page(b"PK\3\4 no episode", episode("bubbles"))
    expect(page.locator(TOAST)).to_contain_text("episode 0 cannot be opened: this is not a compact episode")
    expect(page.locator("h1")).to_have_text("bubble_junction")
    page.keyboard.press("e")
    expect(page.locator(".row[data-error]")).to_have_count(1)
