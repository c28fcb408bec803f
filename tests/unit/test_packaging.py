"""The wheel: all that belongs to the packages, nothing left behind, and a place for what it writes."""

import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("algorithms", "benchmark", "configs", "scenarios", "smarts", "smarts_agent_kit")


def git(*arguments):
    command = ["git", *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()


def untracked():
    """Return what git does not track, but for what running leaves, also that of tests beside this one."""
    lines = git("status", "--porcelain", "--ignored", "--untracked-files=normal")
    left = re.compile(r"__pycache__|_cache/|\.hypothesis/|scenarios/.*/build/")
    return {line for line in lines if not left.search(line)}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    before = untracked()
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run([*command, "--wheel-dir", str(folder), str(ROOT)], cwd=folder, check=True)
    assert untracked() == before
    (file,) = folder.glob("*.whl")
    return file


def test_the_wheel_holds_what_git_holds_of_the_packages(wheel):
    expected = set(git("ls-files", "--cached", "--others", "--exclude-standard", *FOLDERS))
    found = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    built_from = "smarts/envision/page/"  # the sources of viewer.html, which is in the wheel
    assert found == {n for n in expected if (ROOT / n).is_file() and not n.startswith(built_from)}
    assert "smarts/envision/viewer.html" in found
    assert {f"{package}/py.typed" for package in FOLDERS if package != "configs"} <= found
    assert {"configs/paper_table.yaml", "scenarios/intersection/scenario.py"} <= found


EXPERIMENT = """
extends: quickstart.yaml
tasks: [intersection]
"""
ELSEWHERE = """
import sys
sys.path.insert(0, sys.argv[1])
from pathlib import Path
import smarts
from benchmark.experiment.config import read_experiment
from smarts.sstudio.build import build_scenario
print(Path(smarts.__file__).parents[1])
print(read_experiment(Path("own.yaml")).algorithms, read_experiment(Path("paper_table")).name)
print(build_scenario("loop").directory)
from smarts.geometry.segments import project
print(project.stats.cache_path)
"""


def test_a_wheel_that_cannot_be_written_to_finds_its_configs_and_writes_elsewhere(wheel, tmp_path):
    site, own = tmp_path / "site-packages", tmp_path / "own"
    own.mkdir()
    zipfile.ZipFile(wheel).extractall(site)
    (own / "own.yaml").write_text(EXPERIMENT)
    for place in [site, *site.rglob("*")]:
        place.chmod(0o555)
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache"), "HOME": str(tmp_path / "home")}
    environment.pop("NUMBA_CACHE_DIR", None)
    # The root user may write everywhere, unless it gives that up.
    as_user = ["setpriv", "--bounding-set=-all", "--inh-caps=-all"] if os.geteuid() == 0 else []
    command = [*as_user, sys.executable, "-c", ELSEWHERE, str(site)]
    run = subprocess.run(command, cwd=own, env=environment, capture_output=True, text=True, check=True)
    place, experiment, built, kernels = run.stdout.splitlines()
    assert (place, experiment) == (str(site), "('ppo',) paper_table")
    assert Path(built).is_relative_to(tmp_path / "cache")
    assert Path(kernels).is_relative_to(tmp_path)
    assert not Path(kernels).is_relative_to(site)
    assert not list(site.rglob("build"))
