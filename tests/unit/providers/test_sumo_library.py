"""Copies of libsumo are independent, work in all kinds of processes, and leave nothing on disk."""

import errno
import multiprocessing
import os
import subprocess
import sys
from pathlib import Path

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


def test_copies_share_code_pages():
    libraries = [SumoLibrary() for _ in range(2)]
    code = [
        (line.split()[4], line.split()[2])
        for line in Path("/proc/self/maps").read_text().splitlines()
        if "_libsumo.so" in line and " r-xp " in line
    ]
    assert len(code) >= 2
    assert len(set(code)) == 1
    for library in libraries:
        library.close()


def test_copies_do_not_share_a_simulation(country):
    files = country.road()
    one, other = SumoLibrary(), SumoLibrary()
    for library, seed in ((one, 1), (other, 2)):
        library.start(["-n", str(files.net), "-r", str(files.routes[0]), "--seed", str(seed), *OPTIONS])
    one.simulation.step(10.0)
    assert (one.simulation.getTime(), other.simulation.getTime()) == (10.0, 0.0)
    one.close()
    other.simulation.step(0.0)
    other.close()


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


def test_files_of_other_file_systems_with_the_same_inode_are_ignored(monkeypatch):
    copy = os.memfd_create("copy")
    line = f"1000-2000 r-xp 00000000 fe:01 {os.fstat(copy).st_ino} /usr/lib/libother.so\n"
    monkeypatch.setattr(Path, "read_text", lambda _: line)
    assert shared_code.mappings_of(copy) == []
    os.close(copy)


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
    """Of 29 MB, a copy keeps only the pages that were written to."""
    kept = []

    def share_code(copy, original):
        shared_code.share_code(copy, original)
        mapped = sum(part.end - part.begin for part in shared_code.mappings_of(copy))
        kept.append((mapped, os.fstat(copy).st_blocks * 512))

    monkeypatch.setattr(sumo_library, "share_code", share_code)
    sumo_library._load(99)
    assert min(kept[0]) > 0
    assert max(kept[0]) < 2e6


def test_gaps_between_segments_are_not_read(tmp_path):
    """Linkers for large pages leave gaps, which the loader maps without read access."""
    (tmp_path / "original").write_bytes(b"content" * 1000)
    script = (
        "import mmap, os; from pathlib import Path; from smarts.providers.shared_code import *\n"
        f"original = Path({str(tmp_path / 'original')!r}); copy = os.memfd_create('copy')\n"
        "os.write(copy, original.read_bytes())\n"
        "room = mmap.mmap(copy, 4096, mmap.MAP_PRIVATE, prot=0)\n"
        "print([part.access for part in mappings_of(copy)]); share_code(copy, original); print('shared')\n"
    )
    assert ask(script) == ("['---p']\nshared\n", "")


def test_load_errors_name_the_packages_to_install(tmp_path):
    (tmp_path / "libsumo").mkdir()
    (tmp_path / "libsumo" / "__init__.py").touch()
    (tmp_path / "libsumo" / "_libsumo.so").write_bytes(b"\0" * 1000)
    errors = ask(ASK, PYTHONPATH=os.pathsep.join([str(tmp_path), *sys.path]))[1]
    assert "libsumo does not load" in errors
    assert "apt-get install -y libgl1 libx11-6" in errors


def test_at_the_limit_of_open_files_no_package_is_asked_for(monkeypatch):
    def used_up(name):
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr(sumo_library.os, "memfd_create", used_up)
    with pytest.raises(OSError, match="Too many open files"):
        sumo_library._load(98)


def test_maps_with_a_projection_load_without_warnings(country):
    net = country.folder / "projected.net.xml"
    projection = 'projParameter="+proj=utm +zone=32 +ellps=WGS84 +datum=WGS84 +units=m +no_defs"'
    plain = country.road().net.read_text()
    net.write_text(plain.replace('projParameter="!"', projection))
    assert projection in net.read_text()
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PROJ_")}
    script = (
        "import sys; from smarts.providers.sumo_library import SumoLibrary;"
        " library = SumoLibrary(); library.start(sys.argv[1:]); library.simulation.step(0.0); library.close()"
    )
    command = [sys.executable, "-c", script, "-n", str(net), *OPTIONS]
    ran = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert (ran.stdout, ran.stderr) == ("", "")
