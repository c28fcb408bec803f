"""What the process of a run sends, and what is left of one that is killed."""

import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from benchmark.experiment.models import Experiment
from benchmark.experiment.runs import runs_of
from benchmark.results.files import files_in
from benchmark.results.progress import read_progress
from benchmark.results.run_folder import RunFolder
from benchmark.running.jobs import scratch_folder
from benchmark.running.messages import Began, Kept, Line, Noted, RunProgress
from benchmark.running.writing import RunWriter


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
