"""A run knows the weights and the data that it began with by their digest, not by their place."""

import shutil

import yaml

from benchmark.experiment.models import Experiment
from benchmark.experiment.runs import runs_of
from benchmark.results.files import ResultsError, write_files
from benchmark.results.run_folder import RunFolder
from benchmark.running.messages import Began, Kept
from benchmark.running.training import with_files
from benchmark.running.writing import RunWriter
from tests.raising import raises


def run_from_weights(origin):
    task = {"name": "loop", "scenarios": ["loop"], "start_from": str(origin)}
    (run,) = runs_of(Experiment(name="far", algorithms=["ppo"], tasks=[task], traffic=["light"], seeds=[1]))
    return run


def test_only_a_run_that_has_not_begun_needs_what_it_starts_from(tmp_path):
    for name in ("origin", "moved"):
        weights = tmp_path / name / "checkpoint" / "learner_group" / "learner" / "rl_module" / "weights"
        weights.parent.mkdir(parents=True)
        weights.write_bytes(b"weights")
    run, moved = (run_from_weights(tmp_path / name) for name in ("origin", "moved"))
    folder = RunFolder(tmp_path / "run")
    writer = RunWriter(run, folder)
    assert writer.inputs() == {"start_from/weights": b"weights"}
    writer.take(Began({}, {}))
    writer.take(Kept("checkpoint", {"training.json": b"{}"}))
    folder.check(moved.content())
    shutil.rmtree(tmp_path / "origin")
    folder.check(run.content())
    folder.check_start(run.content())
    with raises(ResultsError, tmp_path / "origin"):
        RunFolder(tmp_path / "new").check_start(run.content())
    (tmp_path / "moved" / "config.yaml").write_text(yaml.safe_dump({"algorithm": "dqn"}))
    with raises(ResultsError, tmp_path / "moved", values=["dqn", "ppo"]):
        RunFolder(tmp_path / "new").check_start(moved.content())
    (tmp_path / "moved" / "config.yaml").write_text(yaml.safe_dump({"algorithm": "centralised_v"}))
    RunFolder(tmp_path / "new").check_start(moved.content())  # the policies are PPO's
    weights.write_bytes(b"others")
    with raises(ResultsError, folder.config, values=["start_from"]):
        folder.check(moved.content())


def test_a_training_that_goes_on_needs_the_same_data_and_its_test_none(tmp_path, monkeypatch):
    data, folder = tmp_path / "cues.parquet", RunFolder(tmp_path / "run")
    data.write_bytes(b"one")
    monkeypatch.chdir(tmp_path)
    task = {"name": "loop", "scenarios": ["loop"]}
    settings = {"bc": {"data": data.name}}
    given = {"algorithms": ["bc"], "tasks": [task], "traffic": ["light"], "seeds": [1], "settings": settings}
    (run,) = runs_of(Experiment(name="data", **given))
    assert run.content()["settings"]["data"] == str(data)
    writer = RunWriter(run, folder)
    files = writer.inputs()
    assert files == {"data/cues.parquet": b"one"}
    write_files(tmp_path / "inputs", files)
    assert with_files(run, tmp_path / "inputs").settings["data"] == str(tmp_path / "inputs/data/cues.parquet")
    writer.take(Began({}, {}))
    writer.take(Kept("checkpoint", {"training.json": b"{}"}))
    data.write_bytes(b"two")
    with raises(ResultsError, folder.config, values=["data"]):
        folder.check(run.content())
    data.unlink()
    folder.check(run.content())
    with raises(ResultsError, f"data {str(data)!r}"):
        RunWriter(run, folder).inputs()
    folder.note(status="testing")
    assert RunWriter(run, folder).inputs() == {}
