"""A budget in minutes: what counts towards it, on a clock that only training and validation move."""

from types import SimpleNamespace

import pytest
import ray

from benchmark.experiment.config import read_experiment
from benchmark.experiment.models import Resources
from benchmark.experiment.runs import runs_of
from benchmark.results.progress import read_progress
from benchmark.results.run_folder import RunFolder
from benchmark.running import training
from benchmark.running.cluster import start_ray
from benchmark.running.messages import Began
from benchmark.running.writing import RunWriter

TINY = """
algorithms: [ppo]
tasks: [loop]
traffic: [no_social_vehicles]
seeds: [3]
training: {rollout_fragment_length: 4}
environment: {agents: 1}
budget: {agent_steps: null, minutes: 0.05}
evaluation: {validations: 3, validation_episodes: 1}
resources: {num_envs_per_env_runner: 1}
"""
TRAINING, VALIDATION, CHECKPOINT = 1.0, 100.0, 1000.0
"""What each takes on the clock [s]."""


class Clock:
    def __init__(self):
        self.now = 0.0

    def slow(self, seconds, function):
        """Return a function that takes this long."""

        def call(*arguments, **named):
            self.now += seconds
            return function(*arguments, **named)

        return call


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(training, "time", SimpleNamespace(monotonic=lambda: clock.now))
    monkeypatch.setattr(training, "evaluate", clock.slow(VALIDATION, training.evaluate))
    return clock


@pytest.fixture
def _ray():
    start_ray(Resources())
    yield
    ray.shutdown()


def begun(run, folder):
    """Return the writer of a run that begins or continues."""
    writer = RunWriter(run, folder)
    writer.take(Began({}, {}))
    return writer


@pytest.mark.usefixtures("_ray")
def test_minutes_are_those_of_training_over_a_restart(tmp_path, clock):
    file = tmp_path / "tiny.yaml"
    file.write_text(TINY)
    (run,) = runs_of(read_experiment(file))
    folder = RunFolder(tmp_path / "run")

    def one(algo):
        algo.train = clock.slow(TRAINING, algo.train)
        algo.save_to_path = clock.slow(CHECKPOINT, algo.save_to_path)
        return training.Training(run, folder, algo)

    with training.algorithm_of(run) as algo:
        first, writer = one(algo), begun(run, folder)
        taken = (writer.take(message) for message in first.go())
        assert next(filter(None, taken)).line["seconds"] == TRAINING
        assert (first.ended_by, first.validations) == (None, 1)
    clock.now += 10_000.0  # nobody is there
    with training.algorithm_of(run) as algo:
        second, writer = one(algo), begun(run, folder)
        # Three seconds in all, of which the first was before the restart.
        taken = (writer.take(message) for message in second.go())
        assert [progress.line["seconds"] for progress in taken if progress] == [2.0, 3.0]
        assert (second.ended_by, second.validations) == ("minutes", 3)
    assert read_progress(folder.progress)["seconds"].tolist() == [1.0, 2.0, 3.0]
