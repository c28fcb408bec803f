"""Copies of libsumo are independent, work in all kinds of processes, and leave nothing on disk."""

import multiprocessing
import os
import subprocess
import sys

import pytest

from smarts.errors import TrafficError
from smarts.providers import shared_code, sumo_library
from smarts.providers.sumo_library import SumoLibrary
from tests.raising import raises

OPTIONS = ["--step-length", "0.1", "--no-step-log", "--no-warnings", "--xml-validation", "never"]


def run(net, routes, seed=1):
    """Return the name and position of every vehicle after 20 s."""
    library = SumoLibrary()
    library.start(["-n", str(net), "-r", str(routes), "--seed", str(seed), *OPTIONS])
    library.simulation.step(20.0)
    poses = [(name, library.vehicle.getPosition(name)) for name in library.vehicle.getIDList()]
    library.close()
    return poses


def test_the_lowest_free_copy_is_reused():
    first, second = SumoLibrary(), SumoLibrary()
    assert second.index == first.index + 1
    first.close()
    first.close()
    third = SumoLibrary()
    assert third.index == first.index
    second.close()
    third.close()


def test_errors_carry_sumos_reason_and_place(country):
    files = country.road()
    library = SumoLibrary()
    with raises(TrafficError, "here", values=["/no.net.xml"]):
        library.start(["-n", "/no.net.xml", *OPTIONS], place="here")
    library.start(["-n", str(files.net), *OPTIONS])
    with raises(TrafficError, values=["unknown"]), library.errors("failed to ask"):
        library.vehicle.getSpeed("unknown")
    library.close()


def test_simulations_that_are_not_closed_free_their_files(country):
    files = country.road()
    run(files.net, files.routes[0])
    before = len(os.listdir("/proc/self/fd"))
    for _ in range(5):
        library = SumoLibrary()
        library.start(["-n", str(files.net), "--route-files", str(files.routes[0]), *OPTIONS])
        del library
    # The copy keeps SUMO's own open files until its next load.
    run(files.net, files.routes[0])
    assert len(os.listdir("/proc/self/fd")) == before


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_child_processes_compute_the_same(country, method):
    """The parent's simulation is not affected by the child process."""
    files = country.road()
    expected = run(files.net, files.routes[0])
    parent = SumoLibrary()
    parent.start(["-n", str(files.net), "-r", str(files.routes[0]), "--seed", "1", *OPTIONS])
    parent.simulation.step(10.0)
    with multiprocessing.get_context(method).Pool(1) as pool:
        assert pool.apply(run, (files.net, files.routes[0])) == expected
    parent.simulation.step(20.0)
    assert [(name, parent.vehicle.getPosition(name)) for name in parent.vehicle.getIDList()] == expected
    parent.close()


ASK = """
import os
from smarts.providers.sumo_library import SumoLibrary
libraries = [SumoLibrary() for _ in range(4)]
print([library.index for library in libraries])
names = [os.path.realpath(f"/proc/self/fd/{name}") for name in os.listdir("/proc/self/fd")]
print(sum("libsumo" in name for name in names))
"""


def ask(script: str, **environment: str) -> tuple[str, str]:
    """Return the output and the error output of a process."""
    command = [sys.executable, "-c", script]
    ran = subprocess.run(command, env={**os.environ, **environment}, capture_output=True, text=True)
    return ran.stdout, ran.stderr


def test_copies_leave_nothing_behind(tmp_path):
    assert ask(ASK, XDG_CACHE_HOME=str(tmp_path), TMPDIR=str(tmp_path)) == ("[0, 1, 2, 3]\n0\n", "")
    assert list(tmp_path.rglob("*")) == []


def test_a_copy_keeps_only_its_data(monkeypatch):
    """The library has 29 MB; a copy keeps only the pages that were written to."""
    kept = []

    def share_code(copy, original):
        shared_code.share_code(copy, original)
        mapped = sum(part.end - part.begin for part in shared_code.mappings_of(copy))
        kept.append((mapped, os.fstat(copy).st_blocks * 512))

    monkeypatch.setattr(sumo_library, "share_code", share_code)
    sumo_library._load(99)
    assert min(kept[0]) > 0
    assert max(kept[0]) < 2e6


def test_load_errors_name_the_packages_to_install(tmp_path):
    (tmp_path / "libsumo").mkdir()
    (tmp_path / "libsumo" / "__init__.py").touch()
    (tmp_path / "libsumo" / "_libsumo.so").write_bytes(b"\0" * 1000)
    errors = ask(ASK, PYTHONPATH=os.pathsep.join([str(tmp_path), *sys.path]))[1]
    assert "libsumo does not load" in errors
    assert "apt-get install -y libgl1 libx11-6" in errors
