"""Several learners: each takes its rows of every minibatch, and all become what one learner becomes."""

import math
import os
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import ray
import torch

import algorithms
from algorithms.errors import LearnerFailure
from algorithms.parts.noise import RowGenerator, exponential
from tests.unit.algorithms.joint.test_rllib_contract import small
from tests.unit.algorithms.learner_processes import (
    LR,
    Failing,
    Process,
    arrays,
    learn,
    process_id,
    rig,
)
from tests.unit.algorithms.rigs import PLAYING, first, train, weights_of

pytestmark = pytest.mark.usefixtures("cluster")

TOLERANCE = 0.02 * LR
"""Tolerance of weights: Adam divides gradients by their size, so a small one's error is a part of `lr`."""


def meeting_in(folder, size):
    """Yield processes that meet in a file, and end them."""
    actors: list[Any] = [Process.remote(rank, size, str(folder / "point")) for rank in range(size)]  # type: ignore[attr-defined]
    yield actors
    for actor in actors:
        ray.kill(actor)


@pytest.fixture(scope="module")
def processes(cluster, tmp_path_factory):
    """Provide two processes."""
    yield from meeting_in(tmp_path_factory.mktemp("two"), 2)


def every(processes, method, *given):
    """Return what a method of all processes returns."""
    return ray.get([getattr(process, method).remote(*given) for process in processes])


def check_equal(name, processes, settings):
    """Compare one learner with several that get the same rollouts."""
    one = rig(name, **settings)
    rollouts, results = [], {}
    before = arrays(one.weights())
    for made in range(3):
        rollouts.append(one.rollout(24))
        results = learn(one.learner, rollouts[-1:], made)
    expected = arrays(one.weights())
    assert any((before[name] != expected[name]).any() for name in before)
    (first, reported, drawn), *others = every(processes, "learn", name, rollouts, settings)
    for leaf, array in expected.items():
        np.testing.assert_allclose(first[leaf], array, atol=TOLERANCE, rtol=1e-4, err_msg=leaf)
    for weights_of_other, also, drawn_too in others:
        for leaf, array in first.items():
            np.testing.assert_array_equal(array, weights_of_other[leaf], err_msg=leaf)
        assert (reported, drawn) == (also, drawn_too)
    assert reported.keys() == results.keys()
    for leaf, value in results.items():
        assert reported[leaf] == pytest.approx(value, rel=1e-3, abs=1e-5), leaf
    assert drawn == one.learner.rng.random()


@pytest.mark.parametrize("name", first("ppo", *(name for name in PLAYING if name != "ppo")))
def test_two_learners_become_what_one_becomes(name, processes):
    check_equal(name, processes, {})


def test_learners_begin_with_the_weights_of_the_first(processes):
    first, second = every(processes, "first_weights", "ppo")
    other = arrays(rig("ppo", seed=1).weights())
    assert any((first[leaf] != other[leaf]).any() for leaf in other)
    for leaf, array in first.items():
        np.testing.assert_array_equal(second[leaf], array, err_msg=leaf)


def test_random_numbers_are_those_of_the_whole_minibatch(processes):
    generator = RowGenerator()
    expected, after = exponential(torch.zeros(5, 3), generator), exponential(torch.zeros(3), generator)
    parts = every(processes, "drawn", 5)
    assert [rows.tolist() for rows, *_ in parts] == [[0, 2, 4], [1, 3]]
    for rows, numbers, whole, later in parts:
        assert torch.equal(numbers, expected[rows])
        assert torch.equal(whole, expected[:, 0])
        assert torch.equal(later, after)


def test_all_learners_take_a_minibatch_of_fewer_rows_than_learners_whole(processes):
    for rows, numbers, whole, _ in every(processes, "drawn", 1):
        assert rows.tolist() == [0]
        assert torch.equal(numbers[:, 0], whole)


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["ppo", "dqn"])
def test_a_training_continues_with_another_number_of_learners(build, tmp_path, name):
    alone, two = build(small(name)), build(small(name).learners(num_learners=2, num_cpus_per_learner=0))
    for algo in (alone, two):
        train(algo, 2)
        algo.save_to_path(str(tmp_path / f"{len(algo.learner_group)}"))
    alone.restore_from_path(str(tmp_path / "2"))
    two.restore_from_path(str(tmp_path / "0"))
    control = build(small(name))
    for algo, count in ((alone, 2), (two, 2), (control, 4)):
        result = train(algo, count)
        assert result["learners"]["agent_0"]["gradient_norm"] > 0
    for algo in (alone, two):
        for leaf, array in weights_of(control).items():
            np.testing.assert_allclose(weights_of(algo)[leaf], array, atol=1e-4, err_msg=leaf)


def processes_of(algo):
    """Return the ids of the learners' processes."""
    return [each.get() for each in algo.learner_group.foreach_learner(process_id)]


def assert_gone(pids):
    """Wait until no process of these is left."""
    deadline = time.monotonic() + 60
    while alive := [pid for pid in pids if Path(f"/proc/{pid}").exists()]:
        assert time.monotonic() < deadline, alive
        time.sleep(0.1)


@pytest.mark.nightly
@pytest.mark.parametrize("lost", [0, 1])
def test_a_lost_learner_ends_the_training(lost, build):
    algo = build(small("ppo").learners(num_learners=2, num_cpus_per_learner=0))
    train(algo, 1)
    pids = processes_of(algo)
    os.kill(pids[lost], signal.SIGKILL)
    with pytest.raises(LearnerFailure, match=rf"learner {lost}: .*lost.*of 2"):
        train(algo, 1)
    assert_gone(pids)


@pytest.mark.nightly
def test_an_error_in_one_learner_ends_the_training_by_name(build):
    config = small("ppo").training(learner_class=Failing)
    algo = build(config.learners(num_learners=2, num_cpus_per_learner=0))
    pids = processes_of(algo)
    with pytest.raises(LearnerFailure, match="learner 1: ValueError: half a loss"):
        train(algo, 1)
    assert_gone(pids)


@pytest.mark.parametrize("name", ["ppo", "commnet"])
def test_weights_that_are_not_finite_are_an_error_that_names_their_network(name):
    made = rig(name)
    rollouts = [made.rollout(24) for _ in range(2)]
    learn(made.learner, rollouts[:1])
    # CommNet's groups share one network.
    owner = "b" if "b" in made.learner.module else "shared"
    with torch.no_grad():
        made.learner.net(owner).trained_parameters()[0].view(-1)[0] = math.inf
    with pytest.raises(LearnerFailure, match=rf"weights of .*\b{owner}\b.* are not finite after 96 env"):
        learn(made.learner, rollouts[1:], 1)


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_a_gpu_that_is_not_there_is_refused():
    with pytest.raises(ValueError, match="num_gpus_per_learner=1"):
        algorithms.config("ppo").learners(num_gpus_per_learner=1).validate()
    algorithms.config("ppo").learners(num_gpus_per_learner=1, num_learners=1).validate()
