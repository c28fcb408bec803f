"""A report's page in real Chromium: as wide as the window, few words before the fold, with replays."""

import pytest
from playwright.sync_api import Browser, expect

from benchmark.report.content import make_report
from benchmark.report.episode_pages import Replays
from benchmark.report.html import report_page
from benchmark.report.robustness import robustness_of
from benchmark.report.summary import summaries_of
from benchmark.results.reading import read_results
from smarts.envision.viewer_page import Embedded, page_with
from tests.envision.conftest import DESKTOP, PATIENCE, PHONE
from tests.envision.pages import episode
from tests.hand_made_results import ALONE, SOCIAL, write_experiment, write_test

pytestmark = pytest.mark.browser

MOST_WORDS = 600
ENDS = [["goal", "goal"], ["goal", "collision"], ["time_out", "off_road"]] * 4


@pytest.fixture
def address(tmp_path) -> str:
    """A report of two algorithms and a scripted policy in two conditions, with two replays."""
    write_experiment(tmp_path, algorithms=["ppo", "dqn"], traffic=[ALONE, SOCIAL], scripted=["keep_lane"])
    for name in ("ppo", "dqn", "keep_lane"):
        for traffic in (ALONE, SOCIAL):
            write_test(tmp_path, name, ENDS, traffic=traffic)
    report = make_report(read_results(tmp_path))
    shown = [Embedded("a1", "first", episode("intersection"), "best")]
    shown.append(Embedded("b2", "second", episode("keep_lane"), "worst"))
    replays = Replays((("best", "a1"), ("worst", "b2")), page_with(shown).encode())
    page = tmp_path / "report.html"
    page.write_text(report_page(report, summaries_of(report), robustness_of(report), replays))
    return page.as_uri()


@pytest.mark.parametrize(
    ("size", "scheme"), [(DESKTOP, "light"), pytest.param(PHONE, "dark", marks=pytest.mark.nightly)]
)
def test_a_report_fits_the_window_is_short_and_plays_episodes(browser: Browser, address, size, scheme):
    page = browser.new_page(viewport={"width": size[0], "height": size[1]}, color_scheme=scheme)
    page.set_default_timeout(PATIENCE)
    problems: list[str] = []
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("console", lambda message: problems.append(message.text) if message.type == "error" else None)
    page.goto(address)
    assert page.evaluate("document.documentElement.scrollWidth") == size[0]
    assert len(page.locator("body").inner_text().split()) <= MOST_WORDS
    page.locator("#player").scroll_into_view_if_needed()
    player = page.frame_locator("#player")
    expect(player.locator(".app[data-ready] h1")).to_contain_text("intersection")
    page.get_by_role("button", name="Worst").click()
    expect(player.locator(".app[data-ready] h1")).to_contain_text("keep_lane")
    page.locator(".legend [data-series]").first.hover()
    assert page.locator("svg .is-chosen").count() > 0
    page.locator("summary").first.click()
    assert not problems
    page.close()
