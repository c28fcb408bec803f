"""A short training, from which others start, and which other numbers of agents play."""

import numpy as np
import pytest
import ray

from benchmark.experiment.config import read_experiment
from benchmark.experiment.models import Resources
from benchmark.experiment.runs import run_from, runs_of
from benchmark.results.files import write_files
from benchmark.results.run_folder import RunFolder
from benchmark.running import training
from benchmark.running.cluster import start_ray
from benchmark.running.evaluating import Asked, evaluate_checkpoint
from benchmark.running.messages import Began
from benchmark.running.writing import RunWriter

TINY = """
algorithms: [ppo]
tasks: [{name: loop, scenarios: [loop], start_from: START}]
traffic: [no_social_vehicles]
seeds: [3]
training: {rollout_fragment_length: 4, sharing: all}
budget: {agent_steps: 200}
evaluation: {validations: 0}
resources: {num_envs_per_env_runner: 1}
"""


def run_of(folder, agents, start=None, observation="benchmark"):
    file = folder / "ppo.yaml"
    file.write_text(TINY.replace("START", str(start or "null")))
    changes = [f"environment.agents={agents}", f"environment.observation={observation}"]
    (run,) = runs_of(read_experiment(file, changes))
    return run


@pytest.fixture(scope="module", autouse=True)
def _ray():
    start_ray(Resources())
    yield
    ray.shutdown()


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """The folder of a training of two agents."""
    place = tmp_path_factory.mktemp("trained")
    run = run_of(place, 2)
    folder = RunFolder(place / "run")
    writer = RunWriter(run, folder)
    writer.take(Began({}, {}))
    with training.algorithm_of(run) as algo:
        for message in training.Training(run, folder, algo).go():
            writer.take(message)
    writer.close()
    return folder


def started(run, place, trained):
    """Return the weights of a run before its first step, those of the other one, and what did not fit."""
    assert run_from(run.content()).content() == run.content()
    scratch = RunFolder(place)
    write_files(scratch.inputs / "start_from", trained.networks())
    with training.algorithm_of(run) as algo:
        unfit = training.Training(run, scratch, algo).unfit
        own = algo.learner_group.get_weights()
    network = trained.checkpoint / "learner_group/learner/rl_module/shared/module_state.pkl"
    return own["shared"], training.unpickled(network), unfit


def test_a_training_starts_with_the_weights_that_fit(tmp_path, trained):
    run = run_of(tmp_path, 3, trained.path)
    own, other, unfit = started(run, tmp_path / "three", trained)
    assert unfit == []
    first = "body.0.weight"
    assert {name for name in own if np.shape(own[name]) != np.shape(other[name])} == {first}
    # The third agent begins with the number and in the place of the first.
    columns = np.r_[0:197, 195, 197 : other[first].shape[1], other[first].shape[1] - 2]
    for name in own:
        expected = other[name][:, columns] if name == first else other[name]
        np.testing.assert_array_equal(own[name], expected)
    run = run_of(tmp_path, 2, trained.path, "neighbor_rows")
    own, other, unfit = started(run, tmp_path / "other_inputs", trained)
    assert f"shared.{first}" in unfit
    np.testing.assert_array_equal(own["body.2.weight"], other["body.2.weight"])


def test_another_number_of_agents_plays_a_shared_policy(trained):
    for agents in (1, 3):
        table = evaluate_checkpoint(trained.path, Asked(episodes=2, agents=agents), modes=("greedy",))
        assert len(table) == 2 * agents
