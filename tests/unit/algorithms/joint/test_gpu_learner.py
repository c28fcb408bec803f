"""A learner on a GPU becomes what one on the CPU becomes; these tests need a GPU that torch can use."""

import copy

import numpy as np
import pytest
import torch

from tests.unit.algorithms.learner_processes import LR, arrays, learn, rig
from tests.unit.algorithms.rigs import EVERY

pytestmark = [
    pytest.mark.usefixtures("cluster"),
    pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU"),
]

TOLERANCE = 0.02 * LR
"""Tolerance of weights: Adam divides gradients by their size, so a small one's error is a part of `lr`."""


def assert_close(found, expected):
    assert found.keys() == expected.keys()
    for name, array in expected.items():
        np.testing.assert_allclose(found[name], array, atol=TOLERANCE, rtol=1e-4, err_msg=name)


def check_equal(name, settings):
    """Compare a learner on the CPU with one on the GPU, and with each where the other's state was."""
    here, there = rig(name, **settings), rig(name, gpus=1, **settings)
    assert all(x.is_cuda for part in there.weights().values() for x in part.values())
    before = arrays(here.weights())
    assert_close(arrays(there.weights()), before)
    rollouts = [here.rollout(24)]
    learn(here.learner, rollouts)
    learn(there.learner, rollouts)
    here_again, there_again = rig(name, seed=1, **settings), rig(name, seed=1, gpus=1, **settings)
    here_again.learner.set_state(copy.deepcopy(there.learner.get_state()))
    there_again.learner.set_state(copy.deepcopy(here.learner.get_state()))
    everyone = here, there, here_again, there_again
    for made in (1, 2):
        rollout = here.rollout(24)
        reported, *others = [learn(each.learner, [rollout], made) for each in everyone]
    expected = arrays(here.weights())
    assert any((before[leaf] != expected[leaf]).any() for leaf in before)
    for each, results in zip(everyone[1:], others, strict=True):
        assert_close(arrays(each.weights()), expected)
        assert each.learner.rng.random() == copy.deepcopy(here.learner.rng).random()
        assert torch.equal(each.learner.generator.get_state(), here.learner.generator.get_state())
        assert results.keys() == reported.keys()
        for leaf, value in reported.items():
            assert results[leaf] == pytest.approx(value, rel=1e-3, abs=1e-5), leaf


@pytest.mark.parametrize("name", EVERY)
def test_a_gpu_learns_what_the_cpu_learns(name):
    check_equal(name, {})
