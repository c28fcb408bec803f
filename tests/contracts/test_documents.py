"""The pages are what they say: their blocks run, and print what the pages show."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from algorithms.registry import ALGORITHMS
from docs.write_pages import texts
from smarts.agents.sensors import SENSORS
from smarts.types.traffic import TRAFFIC_ENGINES
from tests.blocks import LANGUAGES, ROOT, Page, blocks_of

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
MODULES = [
    file
    for package in ("smarts", "algorithms", "benchmark")
    for file in sorted((ROOT / package).rglob("*.py"))
    if "```" in file.read_text() and blocks_of(file)
]
BLOCKS = [block for page in [*PAGES, *MODULES] for block in blocks_of(page)]
WITH_CODE = sorted({block.page for block in BLOCKS if block.is_code})
ALWAYS_RUN = ("README.md", "extending.md")
"""Pages whose blocks `make test` runs."""
LOADED = re.compile(r"<(?:script|link|img|iframe)[^>]*(?:src|href)=\"(?:https?:)?//[^\"]+\"")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working directory of the page's own, whose modules are forgotten at its end."""
    for registry in (SENSORS, TRAFFIC_ENGINES):  # to which pages add
        monkeypatch.setattr(registry, "_places", {**registry._places})
        monkeypatch.setattr(registry, "_own", {})
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path
    for name, module in [*sys.modules.items()]:
        if str(getattr(module, "__file__", None)).startswith(str(tmp_path)):
            del sys.modules[name]


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, marks=() if page.name in ALWAYS_RUN else pytest.mark.nightly) for page in WITH_CODE],
    ids=lambda page: str(page.relative_to(ROOT)),
)
def test_the_blocks_of_a_page_run(page, folder):
    for block, _, seconds in Page(page, folder).run():
        print(f"{block.place}: {seconds:.1f} s")


def test_pages_count_all_algorithms():
    counted = re.compile(r"\b(\d+) (?:multi-agent )?algorithms\b")
    found = [(page.name, int(count)) for page in PAGES for count in counted.findall(page.read_text())]
    assert found
    assert [(name, count) for name, count in found if count != len(ALGORITHMS)] == []


def test_every_block_has_a_language_that_is_run():
    strange = [f"{block.place}: {block.language!r}" for block in BLOCKS if block.language not in LANGUAGES]
    assert not strange


def test_pages_repeat_the_examples_and_docstrings():
    old = [str(page.relative_to(ROOT)) for page, text in texts() if page.read_text() != text]
    assert not old, "run: make pages"


@pytest.mark.nightly
def test_the_site_builds_without_a_warning_and_loads_nothing_from_the_network(tmp_path):
    build = [sys.executable, "-m", "mkdocs", "build", "--site-dir", tmp_path]
    ended = subprocess.run(build, cwd=ROOT, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr[-3000:]
    pages = [*tmp_path.rglob("*.html")]
    assert tmp_path / "index.html" in pages
    assert not [page for page in pages if LOADED.search(page.read_text())]


def test_the_changelogs_newest_release_is_the_version():
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    releases = re.findall(
        r"^## (\d\S*) \(\d{4}-\d\d-\d\d\)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE
    )
    assert releases[0] == version


def test_the_last_nightly_run_was_of_all_pages_that_train_and_nothing_failed():
    output = (ROOT / "results" / "nightly.txt").read_text()
    nightly = {block.page for block in BLOCKS if block.note.startswith("nightly")}
    assert nightly
    ran = {Path(line).name for line in output.splitlines() if line.startswith("## docs/")}
    assert not [page for page in nightly if page.name not in ran]
    assert output.rstrip().endswith(" 0 failed")
