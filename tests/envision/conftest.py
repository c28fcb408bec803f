"""Real Chromium without a display, which draws by software; errors on a page's console fail the test."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, BrowserContext, ConsoleMessage, Page, expect, sync_playwright

from tests.envision.pages import CHROMIUM, FLAGS, page_with

DESKTOP, PHONE = (1280, 800), (390, 844)
PATIENCE = 180_000
"""Time for the browser to do what it is asked, which draws by software on a machine that is busy [ms]."""


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    found = shutil.which(CHROMIUM)
    assert found, f"{CHROMIUM} is missing: `make test` gets it"
    expect.set_options(timeout=PATIENCE)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture
def open_page(browser: Browser, tmp_path: Path) -> Iterator[Callable[..., Page]]:
    """Open the built page with episodes inside, or an address."""
    problems: list[str] = []
    contexts: list[BrowserContext] = []

    def open_page(
        *episodes: bytes,
        fragment: str = "",
        size: tuple[int, int] = DESKTOP,
        url: str = "",
        scheme: str = "dark",
        may_lose_connection: bool = False,
        script: str = "",
    ) -> Page:
        width, height = size
        context = browser.new_context(
            viewport={"width": width, "height": height},
            has_touch=size == PHONE,
            color_scheme="dark" if scheme == "dark" else "light",
        )
        context.set_default_timeout(PATIENCE)
        contexts.append(context)
        if script:
            context.add_init_script(script)
        page = context.new_page()
        page.on("pageerror", lambda error: problems.append(str(error)))

        def told(message: ConsoleMessage) -> None:
            # Browsers report connections that are refused, whatever the page does about it.
            # A test's server may end before its page.
            is_refused = "ERR_CONNECTION_REFUSED" in message.text
            is_expected = is_refused or (may_lose_connection and "WebSocket" in message.text)
            if message.type == "error" and not is_expected:
                problems.append(message.text)

        page.on("console", told)
        if not url:
            file = tmp_path / f"page{len(contexts)}.html"
            file.write_text(page_with(episodes))
            url = file.as_uri()
        page.goto(url + fragment)
        page.wait_for_selector(".app[data-ready]")
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert not problems
