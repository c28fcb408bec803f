"""Prioritised replay against Schaul's formulas; replayed sequences against the rollouts they come from."""

import numpy as np
import pytest
import torch
from rigs import Rig

from algorithms.joint.env import MEMORY
from tests.games.games import Cues, Ragged
from tests.games.recall import Recall

REPLAY = {"learning_starts": 1, "capacity": 200, "batch_size": 32, "updates_per_step": 0.05}


def test_transitions_are_drawn_by_priority_and_weighed_by_schauls_formula():
    rig = Rig("dqn", Cues, prioritised=True, priority_alpha=0.7, priority_beta=0.5, **REPLAY)
    replay = rig.learner.replay
    replay.add(rig.rollout(20, epsilon=1.0))
    surprise = np.random.default_rng(1).exponential(size=40)
    surprise[3] = 0.0
    replay.reprioritise(torch.arange(40), torch.tensor(surprise))
    scaled = (surprise + 1e-6) ** 0.7
    chance = scaled / scaled.sum()
    batch = replay.sample(np.random.default_rng(2), 200_000)
    assert batch.rows is not None
    assert batch.weights is not None
    counts = np.bincount(batch.rows.numpy(), minlength=40)
    deviation = np.abs(counts - 200_000 * chance) / np.sqrt(200_000 * chance * (1 - chance))
    assert deviation.max() < 4.5
    raw = (40 * chance) ** -0.5
    np.testing.assert_allclose(batch.weights, (raw / raw.max())[batch.rows], rtol=1e-5)


def test_new_transitions_get_the_largest_priority_and_overwritten_ones_are_forgotten():
    rig = Rig("dqn", Cues, prioritised=True, priority_alpha=1.0, **{**REPLAY, "capacity": 50})
    replay = rig.learner.replay
    replay.add(rig.rollout(25, epsilon=1.0))
    replay.reprioritise(torch.arange(50), torch.full((50,), 1.0))
    replay.reprioritise(torch.tensor([7]), torch.tensor([9.0]))
    rows = replay.add(rig.rollout(4, epsilon=1.0))
    assert rows.tolist() == list(range(8))
    rows = replay.sample(np.random.default_rng(0), 20_000).rows.numpy()
    share = np.bincount(rows, minlength=50) / 20_000
    np.testing.assert_allclose(share[:8].sum(), 8 * 9 / (8 * 9 + 42), atol=0.02)


def test_learning_sets_the_priorities_to_the_mean_temporal_difference_and_weighs_the_loss(monkeypatch):
    rig = Rig("dqn", Ragged, sharing="all", prioritised=True, **REPLAY)
    learner = rig.learner
    learner.replay.add(rig.rollout(40, epsilon=1.0))
    learner.replay.reprioritise(torch.arange(30), torch.rand(30) + 0.1)
    batch = learner.replay.sample(np.random.default_rng(0), 32)
    told, losses = [], []
    monkeypatch.setattr(learner.replay, "reprioritise", lambda rows, surprise: told.append(surprise))
    monkeypatch.setattr(learner, "step_optimizer", lambda loss, *modules: losses.append(loss.item()))
    net = learner.net("shared")
    ((_, own),) = batch.groups()
    with torch.no_grad():
        best = net.q(own.next.observations).argmax(-1, keepdim=True)
        following = net.target_q(own.next.observations).gather(-1, best)[..., 0]
        target = own.rewards + learner.gamma * own.bootstrap * following
        difference = (net.q(own.observations).gather(-1, own.actions[..., None])[..., 0] - target).abs()
        huber = torch.where(difference < 1, difference.square() / 2, difference - 0.5)
        expected = (huber * batch.weights[:, None])[own.alive].mean().item()
    learner.update_minibatch(batch)
    for m in range(32):
        assert told[0][m].item() == pytest.approx(difference[m][own.alive[m]].mean().item(), rel=1e-5)
    assert losses == [pytest.approx(expected, rel=1e-5)]


def test_a_restored_prioritised_buffer_draws_the_same():
    rig = Rig("dqn", Cues, prioritised=True, **REPLAY)
    rig.learner.update_joint(rig.rollout(32, epsilon=1.0))
    other = Rig("dqn", Cues, prioritised=True, seed=5, **REPLAY)
    other.learner.set_state(rig.learner.get_state())
    first, second = (r.learner.replay.sample(np.random.default_rng(3), 64) for r in (rig, other))
    assert torch.equal(first.rows, second.rows)
    assert torch.equal(first.weights, second.weights)


def test_sequences_are_consecutive_steps_of_one_copy_with_their_memories():
    rig = Rig("dqn", Ragged, sharing="all", gru=4, sequence_length=8, **REPLAY)
    rig.rollout(16, epsilon=0.5)
    rollout = rig.rollout(16, epsilon=0.5)
    rig.learner.replay.add(rollout)
    batch = rig.learner.replay.sample(np.random.default_rng(0), 80)
    assert (batch.length, len(batch)) == (8, 80)
    masks, found = rollout.masks(), set()
    for c in range(10):
        rows = batch.rows[c::10].numpy()
        assert (np.diff(rows) == 1).all()
        assert rows[0] % 8 == 0
        part, b = divmod(int(rows[0]) // 8, 2)
        found.add((part, b))
        steps = slice(8 * part, 8 * part + 8)
        for name, leaf in batch.observations[0].items():
            np.testing.assert_array_equal(leaf[c::10], rollout.views.observations[0][name][steps, b])
        np.testing.assert_array_equal(batch.alive[c::10], rollout.views.alive[steps, b])
        np.testing.assert_array_equal(batch.fresh[c::10], masks.fresh[steps, b])
        np.testing.assert_array_equal(batch.rewards[c::10], rollout.rewards[steps, b])
    assert len(found) == 4


@pytest.mark.parametrize("name", ["dqn", "qmix"])
def test_replayed_memories_are_those_of_acting_and_of_each_network(name):
    rig = Rig(name, Ragged, sharing="all", gru=4, sequence_length=8, **REPLAY)
    rig.rollout(16, epsilon=0.5)
    rig.learner.replay.add(rig.rollout(16, epsilon=0.5))
    batch = rig.learner.replay.sample(np.random.default_rng(0), 80)
    net = rig.learner.net("shared")
    torch.nn.init.normal_(net.target_q.memory.cell.weight_hh)
    ((_, own),) = batch.groups()
    online, target = rig.learner.following(net, own)
    there = own.bootstrap & own.next.alive
    stored, again = own.next.observations[MEMORY][there], online.observations[MEMORY][there]
    torch.testing.assert_close(again, stored, rtol=0, atol=1e-6)
    assert not torch.allclose(target.observations[MEMORY][there], stored, atol=1e-3)
    before = rig.weights()
    rig.learner.update_minibatch(batch)
    after = rig.weights()
    assert (before["shared"]["q.memory.cell.weight_hh"] != after["shared"]["q.memory.cell.weight_hh"]).any()


def recalled(name, seed, steps=6_000, gru=16):
    """Return the share of cues that greedy agents remember after training."""
    explore = {"epsilon": (1.0, 0.1), "epsilon_steps": 2000, "learning_starts": 200, "updates_per_step": 0.1}
    common = {"lr": 3e-3, "gamma": 0.9, "batch_size": 256, "tau": 0.02, "sharing": "all", **explore}
    rig = Rig(name, Recall, seed=seed, gru=gru, sequence_length=8, **common)
    rig.learn(steps, 16)
    return np.mean([e.returns for e in rig.greedy_episodes(50)])


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["dqn", "vdn", "qmix"])
def test_a_cue_is_remembered_by_values(name):
    """1.0; 0.5 without memory."""
    assert recalled(name, 1) > 0.75
