"""Agents with environments of their own, whose dependencies exclude each other."""

import subprocess
import sys
import threading
import zipfile
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import msgpack
import numpy as np
import pytest
from uv import find_uv_bin

from smarts.agents.hosting.options import HostError
from smarts.errors import SmartsError
from smarts.zoo import find_entry, make_agent, make_spec, separate
from smarts.zoo.registry import add_folder
from smarts.zoo.separate import _environment, clean, install, uninstall
from tests import easing
from tests.hosting import environment, host_of, played, state, steps

pytestmark = pytest.mark.usefixtures("nothing_is_left")

MODULE = """
import conflicted
{easing}

class Conflicted(Easing):
    def __init__(self, wanted="{version}"):
        assert conflicted.VERSION == wanted, conflicted.VERSION
"""
PROJECT = """
[project]
name = "conflicted-{version}"
version = "1.0"
description = "Needs version {version}."
requires-python = "{python}"
dependencies = ["conflicted=={version}"]
[project.entry-points."smarts.zoo"]
"conflicted-{version}-v0" = "conflicted_{version}:Conflicted"
"""


def write_wheel(folder, name, version, files):
    """Write a wheel for the tests."""
    about = {
        "METADATA": f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n",
        "WHEEL": "Wheel-Version: 1.0\nGenerator: tests\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        "RECORD": "",
    }
    files = {**files, **{f"{name}-{version}.dist-info/{file}": text for file, text in about.items()}}
    with zipfile.ZipFile(folder / f"{name}-{version}-py3-none-any.whl", "w") as archive:
        for file, text in files.items():
            archive.writestr(file, text)


@pytest.fixture
def zoo(tmp_path, monkeypatch):
    """An empty zoo, an index of packages without a network, and uv."""
    index = tmp_path / "index"
    index.mkdir()
    for version in "123":
        write_wheel(index, "conflicted", version, {"conflicted.py": f"VERSION = {version!r}\n"})
    for package in (np, msgpack):  # those of this environment, so that nothing is downloaded
        place = Path(package.__file__).parents[1]
        write_wheel(index, package.__name__, "9.9", {f"{package.__name__}_of_tests.pth": f"{place}\n"})
    monkeypatch.setenv("UV_OFFLINE", "1")
    monkeypatch.setenv("UV_FIND_LINKS", str(index))
    monkeypatch.setenv("UV_CACHE_DIR", str(tmp_path / "uv"))
    programs = tmp_path / "programs"
    programs.mkdir()
    (programs / "uv").symlink_to(find_uv_bin())
    monkeypatch.setenv("PATH", f"{programs}:/usr/bin:/bin")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("SMARTS_ZOO", str(tmp_path / "zoo.yaml"))
    return tmp_path


def project(zoo, version, python=">=3.10", dependency=None):
    """Write an agent's project, add it to the zoo, and return its name."""
    folder = zoo / f"agent_{version}"
    folder.mkdir()
    module = MODULE.format(version=version, easing=Path(easing.__file__).read_text())
    (folder / f"conflicted_{version}.py").write_text(module)
    text = PROJECT.format(version=version, python=python)
    (folder / "pyproject.toml").write_text(text.replace("conflicted==", dependency or "conflicted=="))
    (entry,) = add_folder(folder)
    return entry.name


def built(zoo):
    root = zoo / "cache" / "smarts-bench" / "agents"
    return {each.name for each in root.glob("*") if each.is_dir()}


@pytest.mark.slow
def test_agents_with_conflicting_dependencies_drive_in_one_scene(zoo):
    names = [project(zoo, version) for version in "12"]
    for name in names:
        with pytest.raises(HostError):
            make_spec(name)
        folder = install(find_entry(name))
        before = (folder / "pyvenv.cfg").stat().st_mtime_ns
        assert install(find_entry(name)) == folder
        assert (folder / "pyvenv.cfg").stat().st_mtime_ns == before
    assert "conflicted" not in sys.modules
    social = [{"agent": name} for name in names]
    with closing(environment(social, {})) as env:
        env.reset()
        assert len(host_of(env).links) == 2
        states = [state(env), *(state(env) for result in steps(env, 20) if not result.social_failures)]
    assert (states, {}) == played(2 * [{"agent": "tests.hosted_agents:easing-v0"}], {}, count=20)
    with pytest.raises(HostError):
        make_spec(names[0], wanted="2")
    agent, _ = make_agent(names[0], wanted="1")
    agent.close()


@pytest.mark.slow
def test_the_kit_runs_with_numpy_and_msgpack_alone(zoo, tmp_path):
    folder = install(find_entry(project(zoo, "1")))
    python = folder / "bin" / "python"
    show = "import sys, smarts_agent_kit.service, smarts_agent_kit.server; print(smarts_agent_kit.__file__); "
    show += "print([name for name in ('numba', 'ray', 'libsumo', 'smarts') if name in sys.modules])"
    lines = subprocess.run([python, "-I", "-c", show], capture_output=True, text=True, check=True).stdout
    place, loaded = lines.splitlines()
    assert Path(place).is_relative_to(folder)
    assert loaded == "[]"


@pytest.mark.slow
def test_dependencies_that_cannot_be_had_leave_nothing(zoo):
    name = project(zoo, "1", dependency="no-such-package==")
    with pytest.raises(HostError) as raised:
        install(find_entry(name))
    assert "no-such-package" in raised.value.problem
    assert built(zoo) == set()


def test_an_install_waits_for_another_and_removes_what_a_killed_one_left(zoo, monkeypatch):
    entry = find_entry(project(zoo, "1"))
    left = _environment(entry).parent / ".partial-left"
    left.mkdir(parents=True)
    began, builds = threading.Barrier(2, timeout=10), []
    monkeypatch.setattr(separate, "_check_python", lambda *_: began.wait())
    monkeypatch.setattr(separate, "_build", lambda folder, *_: builds.append(folder.mkdir()))
    with ThreadPoolExecutor() as pool:
        one, other = pool.map(install, [entry, entry])
    assert one == other == _environment(entry)
    assert (len(builds), left.exists()) == (1, False)


def test_a_python_that_does_not_fit_is_an_error_before_anything_is_built(zoo):
    name = project(zoo, "1", python="<3.8")
    with pytest.raises(HostError):
        install(find_entry(name))
    with pytest.raises(HostError):
        install(find_entry(name), "/no/such/python")
    assert built(zoo) == set()


def test_environments_go_with_their_agents_or_when_they_are_not_used(zoo):
    names = [project(zoo, version) for version in "12"]
    used = [_environment(find_entry(name)).name for name in names]
    root = zoo / "cache" / "smarts-bench" / "agents"
    old = f"{names[0]}-{'0' * 16}"
    for key in (*used, old, f"gone-v0-{'1' * 16}", f"{names[0]}-more-v0-{'2' * 16}"):
        (root / key / "lib").mkdir(parents=True)
    (root / "notes").mkdir()
    clean([find_entry(names[0]), find_entry(names[1])])
    assert built(zoo) == {*used, "notes"}
    (root / old).mkdir()
    assert len(uninstall(names[0])) == 2
    assert built(zoo) == {used[1], "notes"}
    assert uninstall(names[0]) == []


@pytest.mark.parametrize(
    "text",
    [
        "[project",
        "[project]\nname = 'x'",
    ],
)
def test_projects_that_name_no_agent_are_errors(zoo, text):
    folder = zoo / "broken"
    folder.mkdir()
    (folder / "pyproject.toml").write_text(text)
    with pytest.raises(SmartsError):
        add_folder(folder)
