"""Recurrent policies: acting step by step equals learning by sequences, and memory solves what needs it."""

import numpy as np
import pytest
import torch
from rigs import Rig

from algorithms.joint.env import MEMORY
from tests.games.games import Ragged
from tests.games.recall import Recall

GRU = {"gru": 8, "sequence_length": 8}


@pytest.mark.parametrize(
    ("sharing", "length"), [("all", 1), ("none", 8), ({"odd": ["b"], "even": ["a", "c"]}, 24)]
)
def test_sequences_give_what_was_sampled_step_by_step_over_life_borders(sharing, length):
    rig = Rig("ppo", Ragged, sharing=sharing, gru=8, sequence_length=length)
    rig.rollout(24)
    rollout = rig.rollout(24)
    assert rollout.masks().fresh.any()
    batch = rig.learner.prepare(rollout)
    for group, own in batch.groups():
        net = rig.learner.net(group.id)
        again = net.head.distribution(net.policy(own), own.action_mask).log_prob(own.actions)
        torch.testing.assert_close(again[own.alive], own.log_prob[own.alive], rtol=0, atol=1e-6)


def test_memory_is_empty_where_a_life_begins_and_kept_in_its_final_row():
    rig = Rig("ppo", Ragged, sharing="all", **GRU)
    first, rollout = rig.rollout(24), rig.rollout(24)
    memory, masks = rollout.views.observations[0][MEMORY], rollout.masks()
    np.testing.assert_array_equal(memory[0], first.views.observations[0][MEMORY][-1])
    assert (memory[masks.fresh] == 0).all()
    assert (memory[1:][masks.chain] != 0).any(-1).all()
    net = rig.learner.net("shared")
    cut = 0
    for k, (t, b) in enumerate(rollout.final_at):
        seen = {"": rollout.views.observations[0][""][t, b], MEMORY: memory[t, b]}
        features = net.trunk(net.encoder({n: torch.tensor(x)[None] for n, x in seen.items()}))
        expected = net.memory(features, torch.tensor(seen[MEMORY])[None], None, 1)[0].detach().numpy()
        ended = masks.last[t, b]
        cut += ended.sum()
        found = rollout.final.observations[0][MEMORY][k]
        np.testing.assert_allclose(found[ended], expected[ended], rtol=0, atol=1e-6)
    assert cut > 10


@pytest.mark.parametrize("name", ["ppo", "recurrent_mappo"])
def test_a_stopped_sampler_goes_on_with_the_memories_it_had(name):
    """The hidden states are part of the sampler's state."""
    rig, other = (Rig(name, Recall, seed=4, **GRU) for _ in range(2))
    rig.rollout(6)
    other.sampler.set_state(rig.sampler.get_state())
    first, second = rig.rollout(8), other.rollout(8)
    assert (first.views.observations[0][MEMORY][0] != 0).any()
    for a, b in ((first.log_prob, second.log_prob), (first.rewards, second.rewards)):
        np.testing.assert_array_equal(a, b)
    for k in range(9):
        memory = first.views.observations[0][MEMORY][k]
        np.testing.assert_array_equal(memory, second.views.observations[0][MEMORY][k])


def recalled(name, seed, updates=50, gru=16):
    """Return the share of cues that greedy agents remember after training."""
    learn = {"lr": 5e-3, "gamma": 0.95, "minibatch_size": None, "sharing": "all"}
    rig = Rig(name, Recall, seed=seed, gru=gru, sequence_length=16, **learn)
    for _ in range(updates):
        rig.learner.update_joint(rig.rollout(32))
    return np.mean([e.returns for e in rig.greedy_episodes(50)])


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["ppo", "centralised_v", "recurrent_ippo", "recurrent_mappo"])
def test_a_cue_is_remembered(name):
    """1.0; 0.5 without memory."""
    assert recalled(name, 1) > 0.75
