"""What is shipped to machines of a cluster, and what comes back from them."""

import hashlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import pytest

from benchmark.experiment.models import Experiment
from benchmark.experiment.runs import runs_of
from benchmark.results.files import ResultsError, files_in, write_files
from benchmark.results.progress import read_progress
from benchmark.results.run_folder import RunFolder
from benchmark.running import shipping
from benchmark.running.jobs import scratch_folder
from benchmark.running.messages import Began, Kept, Line, Noted, RunProgress
from benchmark.running.shipping import shipped_code
from benchmark.running.writing import RunWriter
from smarts import shipped
from smarts.sstudio.build import build_scenario
from tests.raising import raises

SCENARIO = """
from pathlib import Path

from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

mission = t.Mission(t.Route(begin=("east_half", 0, 30), end=("west_half", 1, 200)))
gen_scenario(
    t.Scenario(map_spec=t.MapSpec(source="../roads"), ego_missions=[mission]),
    output_dir=Path(__file__).parent,
)
"""


def experiment_of(folder, **values):
    """Return an experiment on a cluster with own code and a scenario whose map is beside its folder."""
    (folder / "own.py").write_text("FOUND = __file__\n")
    (folder / "ring").mkdir()
    (folder / "ring" / "scenario.py").write_text(SCENARIO)
    write_files(folder / "roads", _loop_map())
    return Experiment(
        name="far",
        imports=[str(folder / "own.py")],
        algorithms=["ppo"],
        tasks=[str(folder / "ring")],
        traffic=["no_social_vehicles"],
        seeds=[1],
        resources={"address": "127.0.0.1:1"},
        **{"environment": {"agents": 1}, **values},
    )


def _loop_map():
    loop = shipped.PROGRAM / "scenarios" / "loop"
    return {name: content for name, content in files_in(loop).items() if name.startswith("map.")}


def unpacked(experiment, to):
    """Ship an experiment's code, as Ray does, into a folder."""
    with shipped_code(experiment) as code, zipfile.ZipFile(code["working_dir"]) as archive:
        archive.extractall(to)


def test_what_is_unpacked_needs_nothing_of_the_drivers_machine(tmp_path):
    home, there = tmp_path / "home", tmp_path / "there"
    home.mkdir()
    experiment = experiment_of(home)
    unpacked(experiment, there)
    key = build_scenario(home / "ring").directory.name
    home.rename(tmp_path / "gone")
    assert not [*there.rglob("*.pyc")]
    program = f"""
import json, sys
from importlib.metadata import version
import smarts, benchmark
from benchmark.running.machine import commit
from smarts import shipped
from smarts.registry import import_own, own_paths
from smarts.sstudio.build import build_scenario
from smarts.sstudio.locating import locate
shipped.restore_times()
import_own([{str(home / "own.py")!r}])
import own
built = build_scenario({str(home / "ring")!r})
places = [smarts.__file__, benchmark.__file__, own.FOUND, str(built.directory)]
paths = [str(shipped.original(path)) for path in own_paths()]
print(json.dumps([*places, version("smarts-bench"), commit(), locate("loop").label, paths]))
"""
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "PYTHONPATH": str(there), "HOME": str(tmp_path)},
        cwd=there,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    *places, version, commit, label, paths = json.loads(done.stdout.splitlines()[-1])
    assert all(Path(place).is_relative_to(there) for place in places), places
    assert Path(places[-1]).name == key  # not built again
    assert (version, label) == (shipping.version("smarts-bench"), "loop")
    assert commit == (shipping.commit() or None)
    assert paths == [str(home / "own.py")]
    times = json.loads((there / "shipped" / "times.json").read_text())
    for name, nanoseconds in times.items():
        assert (there / name).stat().st_mtime_ns == nanoseconds == (shipped.PROGRAM / name).stat().st_mtime_ns


def test_equal_code_makes_equal_archives(tmp_path, monkeypatch):
    experiment = experiment_of(tmp_path)
    # Tests beside this one compile kernels meanwhile; these two files stay as they are.
    kernels = [tmp_path / "own.drive-1.py311.nbi", tmp_path / "own.drive-1.py311.1.nbc"]
    for file in kernels:
        file.write_bytes(file.name.encode())
    monkeypatch.setattr(shipping, "_kernels", lambda: iter(kernels))
    entries, digests = [], []
    for _ in range(2):
        with shipped_code(experiment) as code:
            archive = Path(code["working_dir"])
            with zipfile.ZipFile(archive) as opened:
                entries.append([(each.filename, each.CRC) for each in opened.infolist()])
            digests.append(hashlib.sha256(archive.read_bytes()).hexdigest())
    assert entries[0] == entries[1]
    assert digests[0] == digests[1]
    assert not archive.exists()


def test_what_cannot_be_shipped_is_named(tmp_path, monkeypatch):
    silent = experiment_of(tmp_path)
    (tmp_path / "own.py").write_bytes(b"#" + os.urandom(2_000_000).hex().encode())
    monkeypatch.setattr(shipping, "MOST_BYTES", 1_000_000)
    with raises(ResultsError, tmp_path / "own.py"), shipped_code(silent):
        pass
    (tmp_path / "own.py").unlink()
    with raises(ResultsError, tmp_path / "own.py"), shipped_code(silent):
        pass


def test_the_temporary_folder_of_a_killed_process_is_removed_by_the_next_one(tmp_path, monkeypatch):
    program = """
import tempfile, time
from benchmark.running.jobs import scratch_folder
with scratch_folder() as folder:
    print(tempfile.mkdtemp(), flush=True)
    time.sleep(600)
"""
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    command = [sys.executable, "-c", program]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, env=environment, text=True)
    assert process.stdout
    folder = Path(process.stdout.readline().strip()).parent
    assert folder.parent == tmp_path
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with scratch_folder():
        assert folder.exists()
    process.send_signal(signal.SIGKILL)
    process.communicate()
    with scratch_folder():
        assert not folder.exists()
    assert not [*tmp_path.iterdir()]


@pytest.fixture
def run(tmp_path):
    experiment = Experiment(name="far", algorithms=["ppo"], tasks=["loop"], seeds=[1])
    return next(iter(runs_of(experiment)))


def line(iteration):
    return Line({"iteration": iteration, "agent_steps": 10 * iteration, "seconds": 1.0, "completion": 0.5})


def test_messages_become_a_runs_folder(tmp_path, run, capsys):
    folder = RunFolder(tmp_path / "run")
    RunWriter(run, folder).take(Began({}, {}))
    assert capsys.readouterr().err == ""
    writer = RunWriter(run, folder)
    assert capsys.readouterr().err == f"{run}: has no checkpoint to continue from, and begins again\n"
    assert writer.checkpoint() == {}
    writer.take(Began({"begun": "now"}, {"loop": "abc"}))
    files = {"training.json": b'{"iteration": 2}', "learner/state.pkl": b"\x00\xff"}
    for message in (line(1), line(2), Kept("checkpoint", files), line(3)):
        assert writer.take(message) is None
    progress = RunProgress("training", 0.5)
    assert writer.take(progress) is progress
    writer.close()
    assert files_in(folder.checkpoint) == files
    assert folder.facts()["scenarios"] == {"loop": "abc"}
    assert (folder.status, folder.facts()["begun"]) == ("training", "now")
    assert folder.read_config()["algorithm"] == "ppo"

    # The process was lost after its third iteration.
    again = RunWriter(run, folder)
    assert capsys.readouterr().err == ""
    assert again.checkpoint() == files
    again.take(Began({"begun": "later"}, {"loop": "abc"}))
    assert read_progress(folder.progress)["iteration"].tolist() == [1, 2]
    again.take(line(3))
    for message in (
        Kept("episodes/greedy-loop/old", {"a": b"1"}),
        Kept("episodes", {}),
        Kept("episodes/greedy-loop/new", {"a": b"2"}),
        Kept("episodes.parquet", b"table"),
        Noted({"status": "finished"}),
    ):
        again.take(message)
    again.close()
    assert files_in(folder.episodes) == {"greedy-loop/new/a": b"2"}
    assert folder.table.read_bytes() == b"table"
    assert folder.status == "finished"
    assert [each["begun"] for each in folder.facts()["continued"]] == ["later"]
