"""The page as the server gives it: its security policy, its list, its errors."""

import shutil

import pytest
from playwright.sync_api import expect

from smarts.envision.episode_library import EpisodeLibrary
from tests.envision.pages import FIXTURES
from tests.viewers import serving

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def library(tmp_path_factory) -> EpisodeLibrary:
    folder = tmp_path_factory.mktemp("run")
    for name in ("intersection", "bubbles"):
        shutil.copy(FIXTURES / f"{name}.smarts", folder)
    (folder / "damaged.smarts").write_bytes((FIXTURES / "bubbles.smarts").read_bytes()[:40])
    return EpisodeLibrary([folder])


def test_episodes_are_listed_opened_and_linked(open_page, library):
    with serving(library, page="") as server:
        page = open_page(url=server.url)
        expect(page.locator("h1")).to_contain_text("bubble_junction")
        page.keyboard.press("Space")
        page.wait_for_function("() => location.hash.includes('at=')")  # the link to this episode alone
        page.keyboard.press("e")
        assert page.locator(".row").count() == 3
        expect(page.locator(".row[data-error] .error")).not_to_be_empty()
        expect(page.locator(".row[data-error] .open")).to_be_disabled()
        page.get_by_role("button", name="Show intersection beside the others").click()
        page.keyboard.press("Escape")
        expect(page.locator(".cell")).to_have_count(2)
        page.reload()  # whether it plays or not
        page.wait_for_selector(".app[data-ready]")
        expect(page.locator(".cell")).to_have_count(2)
