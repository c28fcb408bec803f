"""A run knows the weights that it began with by their digest, not by their place."""

import shutil

import yaml

from benchmark.experiment.models import Experiment
from benchmark.experiment.runs import runs_of
from benchmark.results.files import ResultsError
from benchmark.results.run_folder import RunFolder
from benchmark.running.messages import Began, Kept
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
    assert writer.start() == {"weights": b"weights"}
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
