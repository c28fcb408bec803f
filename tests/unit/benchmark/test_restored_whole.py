"""`perf.checkpoints`: a run's checkpoint is restored whole, and each part that is not is found."""

import pytest
import ray

from benchmark.experiment.config import Resources, read_experiment
from benchmark.experiment.runs import runs_of
from benchmark.results.run_folder import RunFolder
from benchmark.running import training
from benchmark.running.cluster import start_ray
from benchmark.running.messages import Began
from benchmark.running.writing import RunWriter
from perf.checkpoints import check, differing, values_in

pytestmark = pytest.mark.slow

TINY = """
algorithms: [dqn]
tasks: [loop]
traffic: [no_social_vehicles]
seeds: [3]
training: {rollout_fragment_length: 8, learning_starts: 8, batch_size: 8, checkpoint_replay: true}
environment: {agents: 2}
budget: {agent_steps: 300}
evaluation: {validations: 1, validation_episodes: 1}
resources: {num_envs_per_env_runner: 1}
"""


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory):
    """Return the folder of a run that was trained."""
    place = tmp_path_factory.mktemp("restored")
    file = place / "tiny.yaml"
    file.write_text(TINY)
    (run,) = runs_of(read_experiment(file))
    folder = RunFolder(place / "run")
    writer = RunWriter(run, folder)
    start_ray(Resources())
    writer.take(Began({}, {}))
    with training.algorithm_of(run) as algo:
        for message in training.Training(run, folder, algo).go():
            writer.take(message)
    yield folder.path
    ray.shutdown()


def test_all_that_is_stored_is_restored(run_folder):
    before = values_in(run_folder / "checkpoint")
    found = check(run_folder)
    assert found.values == len(before)
    assert 0 < found.changed_weights < found.changed
    assert differing(before, values_in(run_folder / "checkpoint")) == []
    stored = {
        part: any(f"/{part}/" in place for place in before) for part in ("replay", "optimizer", "joint")
    }
    assert all(stored.values()), stored


def new_targets(learner):
    for group in learner.groups:
        net = learner.net(group.id)
        net.target_q.load_state_dict(net.q.state_dict())


def new_optimisers(learner):
    for optimizer in learner._optimizer_parameters:
        optimizer.state.clear()


SPOILT = {
    "target networks": new_targets,
    "optimisers": new_optimisers,
    "replay": lambda learner: setattr(learner, "replay", learner.make_replay()),
    "torch's numbers": lambda learner: learner.generator.manual_seed(4),
    "numpy's numbers": lambda learner: learner.rng.random(),
    "owed updates": lambda learner: setattr(learner, "_owed", learner._owed + 0.5),
}
OTHERS = [pytest.param(part, marks=pytest.mark.nightly) for part in ("all", *SPOILT) if part != "replay"]


@pytest.mark.parametrize("part", ["replay", *OTHERS])
def test_a_part_that_is_not_restored_is_found(run_folder, part, monkeypatch):
    restore = training.restore

    def spoilt(algo, checkpoint):
        if part != "all":
            restore(algo, checkpoint)
            SPOILT[part](algo.learner_group._learner)

    monkeypatch.setattr(training, "restore", spoilt)
    with pytest.raises(RuntimeError, match="not restored"):
        check(run_folder)


def test_a_checkpoint_with_the_weights_of_a_new_algorithm_shows_nothing(run_folder, monkeypatch):
    monkeypatch.setattr("perf.checkpoints.differing", lambda one, other: [])
    with pytest.raises(RuntimeError, match="shows nothing"):
        check(run_folder)
