"""The page that the package ships is the one that its sources build."""

import shutil
import subprocess
from pathlib import Path

import pytest

from tests.envision.pages import PLACE, ROOT, VIEWER

SOURCES = ROOT / "smarts/envision/page"
LARGEST = 900_000

needs_node = pytest.mark.skipif(shutil.which("npm") is None, reason="Node is not installed")


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy of the sources with the packages that package-lock.json names."""
    folder = tmp_path_factory.mktemp("page") / "smarts/envision/page"
    shutil.copytree(SOURCES, folder, ignore=shutil.ignore_patterns("node_modules", "dist"))
    shutil.copytree(ROOT / "tests/data/envision", folder.parents[2] / "tests/data/envision")
    run("npm", "ci", "--no-audit", "--no-fund", "--silent", cwd=folder)
    return folder


def run(*command: str, cwd: Path) -> str:
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=500)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_page_is_one_small_file():
    page = VIEWER.read_text()
    assert len(page.encode()) < LARGEST
    assert page.count(PLACE) == 1
    assert page.count("<script") == page.count("<style") == 1
    assert "http-equiv" not in page
    assert " src=" not in page


@needs_node
@pytest.mark.nightly
def test_sources_build_the_same_bytes(checkout: Path):
    run("npm", "run", "--silent", "build", cwd=checkout)
    assert (checkout / "dist/index.html").read_bytes() == VIEWER.read_bytes()


@needs_node
@pytest.mark.nightly
def test_the_tests_of_the_sources_pass(checkout: Path):
    run("npm", "run", "--silent", "test", cwd=checkout)
