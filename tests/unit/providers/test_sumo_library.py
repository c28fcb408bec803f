"""Copies of libsumo: independent, shared between processes, made by several at once."""

import contextlib
import errno
import multiprocessing
import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from smarts.errors import TrafficError
from smarts.providers import sumo_library
from smarts.providers.sumo_library import SumoLibrary
from smarts.sstudio.failures import named

NO_FOLDER = FileNotFoundError(errno.ENOENT, "No usable temporary folder")
OPTIONS = ["--step-length", "0.1", "--no-step-log", "--no-warnings", "--xml-validation", "never"]


def run(net, routes, seed=1):
    """Return where every vehicle is after 20 s."""
    library = SumoLibrary()
    library.start(["-n", str(net), "-r", str(routes), "--seed", str(seed), *OPTIONS])
    library.simulation.step(20.0)
    poses = [(name, library.vehicle.getPosition(name)) for name in library.vehicle.getIDList()]
    library.close()
    return poses


def test_the_lowest_free_copy_is_used_again():
    first, second = SumoLibrary(), SumoLibrary()
    assert second.index == first.index + 1
    first.close()
    first.close()
    third = SumoLibrary()
    assert third.index == first.index
    second.close()
    third.close()


def test_copies_run_the_same_pages_of_code():
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


def test_a_copy_in_use_is_refused():
    library = SumoLibrary()
    with pytest.raises(TrafficError, match="in use"):
        SumoLibrary(library.index)
    library.close()


def test_a_forgotten_copy_is_free_again():
    index = SumoLibrary().index
    library = SumoLibrary()
    assert library.index == index
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
    with pytest.raises(
        TrafficError, match=r"here: SUMO failed to start: File '/no.net.xml' is not accessible"
    ):
        library.start(["-n", "/no.net.xml", *OPTIONS], place="here")
    library.start(["-n", str(files.net), *OPTIONS])
    with (
        pytest.raises(TrafficError, match="failed to ask: Vehicle 'nobody' is not known"),
        library.errors("failed to ask"),
    ):
        library.vehicle.getSpeed("nobody")
    library.close()


def test_no_file_descriptors_are_left(country):
    files = country.road()
    run(files.net, files.routes[0])
    before = len(os.listdir("/proc/self/fd"))
    for seed in range(5):
        run(files.net, files.routes[0], seed)
    assert len(os.listdir("/proc/self/fd")) == before


def test_forgotten_simulations_give_their_files_back(country):
    files = country.road()
    run(files.net, files.routes[0])
    before = len(os.listdir("/proc/self/fd"))
    for _ in range(5):
        library = SumoLibrary()
        library.start(["-n", str(files.net), "--route-files", str(files.routes[0]), *OPTIONS])
        del library
    # The copy itself still holds what SUMO opened, until it loads anew.
    run(files.net, files.routes[0])
    assert len(os.listdir("/proc/self/fd")) == before


def test_who_may_open_no_more_files_is_told(country):
    files, library = country.road(), SumoLibrary()
    limits, filled = resource.getrlimit(resource.RLIMIT_NOFILE), []
    resource.setrlimit(resource.RLIMIT_NOFILE, (len(os.listdir("/proc/self/fd")) + 20, limits[1]))
    try:
        with contextlib.suppress(OSError):
            while True:
                filled.append(os.open(os.devnull, os.O_RDONLY))
        for _ in range(2):
            with pytest.raises(TrafficError, match="Too many open files") as caught:
                library.start(["--net-file", str(files.net), *OPTIONS], "here")
            assert caught.value.place == "here"
            assert caught.value.remedy.startswith("close environments")
            assert named(NO_FOLDER, "it", "").remedy == caught.value.remedy
            os.close(filled.pop())
    finally:
        for descriptor in filled:
            os.close(descriptor)
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)
    assert named(NO_FOLDER, "it", "").problem == "it failed: No usable temporary folder"
    library.start(["--net-file", str(files.net), *OPTIONS])
    library.close()


@pytest.mark.parametrize("method", ["fork", "spawn", "forkserver"])
def test_child_processes_compute_the_same(country, method):
    """Also while the parent has a simulation of its own, which goes on undisturbed."""
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
import sys
from smarts.providers.sumo_library import SumoLibrary
from smarts.sstudio.failures import named
libraries = [SumoLibrary() for _ in range(2)]
print([library.index for library in libraries])
"""


def ask(cache: Path) -> subprocess.Popen:
    """Start a process that uses two copies out of a cache folder."""
    environment = {**os.environ, "XDG_CACHE_HOME": str(cache)}
    return subprocess.Popen(
        [sys.executable, "-c", ASK],
        env=environment,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


def copies(cache: Path) -> list[Path]:
    return sorted(cache.rglob("_libsumo.so"))


@pytest.mark.slow
def test_eight_processes_fill_the_cache_at_once(tmp_path):
    processes = [ask(tmp_path) for _ in range(8)]
    for process in processes:
        printed, errors = process.communicate(timeout=120)
        assert (printed.strip(), errors) == ("[0, 1]", "")
    assert len(copies(tmp_path)) == 2
    assert not list(tmp_path.rglob("partial"))


def test_what_a_killed_process_left_is_replaced(tmp_path):
    assert ask(tmp_path).communicate(timeout=60)[0].strip() == "[0, 1]"
    first, second = copies(tmp_path)
    whole = first.stat().st_size
    first.write_bytes(second.read_bytes()[:1000])
    second.unlink()
    (first.parents[1] / "partial").write_bytes(b"half")
    assert ask(tmp_path).communicate(timeout=60)[0].strip() == "[0, 1]"
    assert [copy.stat().st_size for copy in copies(tmp_path)] == [whole, whole]


def test_what_does_not_load_names_the_packages_to_install(tmp_path):
    ask(tmp_path).communicate(timeout=60)
    for copy in copies(tmp_path):
        copy.write_bytes(b"\0" * copy.stat().st_size)
    errors = ask(tmp_path).communicate(timeout=60)[1]
    assert "libsumo does not load" in errors
    assert "apt-get install -y libgl1 libx11-6" in errors


def test_without_a_cache_folder_the_temporary_one_serves(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setattr(sumo_library.tempfile, "gettempdir", lambda: str(tmp_path))
    assert sumo_library._cache_folder() == tmp_path / f"smarts-bench-{os.getuid()}"


def test_maps_with_a_projection_load_in_silence(country):
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


def test_a_closed_library_refuses_to_work(country):
    files = country.road()
    library = SumoLibrary()
    options = ["-n", str(files.net), "-r", str(files.routes[0]), *OPTIONS]
    library.start(options)
    library.close()
    with pytest.raises(TrafficError, match="closed"):
        library.start(options)
    with pytest.raises(TrafficError, match="closed"), library.errors("failed"):
        library.simulation.step(0.0)


def test_a_temporary_folder_that_others_may_write_to_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(sumo_library.tempfile, "gettempdir", lambda: str(tmp_path))
    folder = sumo_library._private_temporary_folder()
    assert folder.stat().st_mode & 0o077 == 0
    folder.chmod(0o777)
    with pytest.raises(TrafficError, match="others may write"):
        sumo_library._private_temporary_folder()
    folder.rmdir()
    (tmp_path / "elsewhere").mkdir()
    folder.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(TrafficError, match="somebody else"):
        sumo_library._private_temporary_folder()
