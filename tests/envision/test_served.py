"""The page as the server gives it: its security policy, its list, its errors."""

import pytest
from playwright.sync_api import expect

from smarts.envision.episode_library import EpisodeLibrary
from tests.maps import straight
from tests.recordings import Drive, at_speed, record
from tests.viewers import serving

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def library(tmp_path_factory) -> EpisodeLibrary:
    folder, graph = tmp_path_factory.mktemp("run"), straight(length=900.0)
    drive = Drive([graph.lane_ids[0]], at_speed(2.0, 200, 10.0), agent="ego")
    for name in ("first", "second", "third"):
        record(folder, graph, [drive], name, scenario=f"{name}_road")
    (folder / "third" / "episode.parquet").write_bytes(b"PAR1")
    return EpisodeLibrary([folder])


def test_episodes_are_listed_opened_and_linked(open_page, library):
    with serving(library, page="") as server:
        page = open_page(url=server.url)
        expect(page.locator("h1")).to_contain_text("first_road")
        page.keyboard.press("Space")
        page.wait_for_function("() => location.hash.includes('at=')")  # the link to this episode alone
        page.keyboard.press("e")
        assert page.locator(".row").count() == 3
        expect(page.locator(".row[data-error] .error")).not_to_be_empty()
        expect(page.locator(".row[data-error] .open")).to_be_disabled()
        page.get_by_role("button", name="Show second_road beside the others").click()
        page.keyboard.press("Escape")
        expect(page.locator(".cell")).to_have_count(2)
        page.reload()  # whether it plays or not
        page.wait_for_selector(".app[data-ready]")
        expect(page.locator(".cell")).to_have_count(2)
