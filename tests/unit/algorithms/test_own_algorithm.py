"""The algorithm of `examples/nightly/q_learner.py`, which docs/develop/algorithms_inside.md shows."""

import importlib
from pathlib import Path

import pytest
import torch

from algorithms.joint.module import JointModule
from algorithms.ppo import LocalValue
from algorithms.registry import ALGORITHMS
from tests.games.games import Constant
from tests.unit.algorithms.rigs import Rig, moved, replayed

EXAMPLE = Path("examples/nightly/q_learner.py")


@pytest.fixture
def example(monkeypatch):
    monkeypatch.syspath_prepend(EXAMPLE.parent)
    own = importlib.import_module(EXAMPLE.stem)
    monkeypatch.setitem(ALGORITHMS, "mine", own.MyConfig.entry._replace(target="q_learner:MyConfig"))
    return own


def test_it_values_what_comes_after_a_time_limit(example):
    """Reward 1 for ever at gamma 0.9 is worth 10; 4.28 if time limits were ends."""
    rig = Rig("mine", Constant, lr=0.01, tau=0.5, gamma=0.9)
    batch = replayed(rig, 64, 64, epsilon=1.0)
    before = rig.weights()
    for _ in range(400):
        rig.learner.update_minibatch(batch)
    assert moved(before, rig.weights()) == {group.id for group in rig.spec.groups}
    for group, own in batch.groups():
        net = rig.learner.net(group.id)
        with torch.no_grad():
            values = net.target_body(net.target_encoder(own.observations))
        assert values.mean().item() == pytest.approx(10.0, abs=0.5)


def test_an_own_policy_or_value_is_not_passed_over_by_stacked_evaluation():
    class Same(JointModule):
        def make_networks(self):
            super().make_networks()

    class Own(JointModule):
        def policy(self, view):
            return -super().policy(view)

    class Further(Own):
        pass

    class OwnValue(LocalValue):
        def value(self, view):
            return -super().value(view)

    assert Same.feedforward_parts is JointModule.feedforward_parts
    for each in (Own, Further, OwnValue):
        assert each.feedforward_parts(object()) is None
