"""Restored weights reach the runners, and replay buffers fit where they are put."""

import numpy as np
import pytest
import torch
from rigs import Rig

import algorithms
from algorithms.errors import CheckpointError
from algorithms.joint.replay import JointReplay
from algorithms.joint.signature import check_signature
from tests.games.games import Cues, Ragged


def trained(seed):
    config = algorithms.config("ppo").environment(Cues).training(hidden=(8,), lr=1e-2, epochs=1)
    config.env_runners(num_env_runners=0, num_envs_per_env_runner=2, rollout_fragment_length=8)
    algo = config.debugging(seed=seed).evaluation(evaluation_duration=3).build_algo()
    algo.train()
    return algo


@pytest.mark.nightly
@pytest.mark.usefixtures("cluster")
def test_weights_of_a_training_as_long_reach_the_runners_that_have_others():
    source, target = trained(3), trained(8)
    runner = target.env_runner_group.local_env_runner
    runner.set_state(target.runner_state())
    target.set_state(source.get_state())
    runner.set_state(target.runner_state())
    wanted = source.learner_group._learner.module["agent_0"].state_dict()
    own = runner.module["agent_0"].state_dict()
    for algo in (source, target):
        algo.stop()
    assert own
    assert all(torch.equal(own[name], wanted[name]) for name in own)


def stored(replay):
    """Return the stored rewards, oldest first."""
    state = replay.get_state()
    rewards = state["arrays"]["rewards"]
    return rewards if state["size"] < replay.capacity else np.roll(rewards, -state["place"], axis=0)


@pytest.mark.parametrize("capacity", [20, 80])
def test_a_replay_buffer_restored_into_another_capacity_holds_the_newest_in_order(capacity):
    rig = Rig("dqn", Ragged, capacity=50)
    filled = rig.learner.replay
    rollouts = [rig.rollout(16) for _ in range(4)]
    other = JointReplay(rig.spec, capacity)
    for rollout in rollouts[:3]:
        filled.add(rollout)
    assert len(filled) == 50
    kept = stored(filled)[-capacity:]
    other.set_state(filled.get_state())
    np.testing.assert_array_equal(stored(other), kept)
    other.add(rollouts[3])
    new = np.concatenate([kept, rollouts[3].rewards[rollouts[3].views.alive[:-1].any(-1)]])
    np.testing.assert_array_equal(stored(other), new[-capacity:])


def test_a_replay_buffer_of_other_sequences_is_refused():
    rig = Rig("dqn", Ragged, gru=4, sequence_length=8, capacity=64)
    rig.learner.replay.add(rig.rollout(8))
    with pytest.raises(CheckpointError, match="sequences of 8 steps, not of 4"):
        JointReplay(rig.spec, 64, 4).set_state(rig.learner.replay.get_state())


def test_what_shapes_no_network_tells_no_checkpoints_apart():
    hot, cold = (algorithms.config("mf_q").training(temperature=t) for t in (0.1, 2.0))
    assert hot.checkpoint_signature() == cold.checkpoint_signature()
    few, many = (algorithms.config("maac").training(attention_heads=n) for n in (2, 4))
    assert few.checkpoint_signature() != many.checkpoint_signature()


def test_a_replay_buffer_stored_without_priorities_is_drawn_from_evenly():
    plain, ranked = Rig("dqn", Ragged, capacity=50), Rig("dqn", Ragged, capacity=50, prioritised=True)
    plain.learner.replay.add(plain.rollout(32))
    ranked.learner.replay.add(ranked.rollout(32))
    ranked.learner.replay.reprioritise(torch.arange(4), torch.full((4,), 9.0))
    ranked.learner.set_state(plain.learner.get_state())
    np.testing.assert_array_equal(stored(ranked.learner.replay), stored(plain.learner.replay))
    np.testing.assert_array_equal(ranked.learner.replay.weights(), 1)
    rows = ranked.learner.replay.add(ranked.rollout(2))
    np.testing.assert_array_equal(ranked.learner.replay.weights()[rows], 1)


def test_a_baseline_tells_checkpoints_apart():
    there, here = (algorithms.config("pg").training(baseline=b).checkpoint_signature() for b in (True, False))
    with pytest.raises(CheckpointError, match="baseline: True there, False here"):
        check_signature(there, here)
