"""Critics with memories: what they know across fragments and trajectories, and what that is worth."""

import copy

import numpy as np
import pytest
import torch
from rigs import Rig

from algorithms.centralised_v import CRITIC
from algorithms.recurrent_ppo import CRITIC_MEMORY
from tests.games.games import Ragged
from tests.games.recall import Luck

BOTH = ["recurrent_ippo", "recurrent_mappo"]
GRU = {"gru": 8, "sequence_length": 8}


def written_out(rig, rollouts):
    """Return values (T, B, N) of all rollouts, step by step from empty memories, and of their final rows."""
    steps, (envs, agents) = len(rollouts[0].rewards), rollouts[0].views.alive.shape[1:]
    memory, values, finals = torch.zeros(envs, agents, 8), [], []
    for rollout in rollouts:
        masks = rollout.masks()
        for t in range(steps):
            value, after = one_step(rig, rollout.views[t], memory)
            values.append(value)
            for k in np.flatnonzero(rollout.final_at[:, 0] == t):
                b = rollout.final_at[k, 1]
                finals.append(one_step(rig, rollout.final[k : k + 1], after[b : b + 1])[0][0])
            memory = torch.where(torch.tensor(masks.chain[t])[..., None], after, 0)
    return torch.stack(values), finals


def one_step(rig, view, memory):
    """Return the values (B, N) and memories (B, N, H) after one observation, agent by agent."""
    seen, alive = torch.tensor(view.observations[0][""]), torch.tensor(view.alive)
    value, after = torch.zeros(alive.shape), torch.zeros_like(memory)
    for i, agent in enumerate(rig.spec.agents):
        if rig.config.algorithm == "recurrent_mappo":
            net = rig.learner.net(CRITIC)
            state = torch.cat([(seen * alive[..., None]).flatten(1), alive.float()], -1)
            features = torch.cat([state, torch.eye(3)[i].expand(len(state), 3)], -1)
        else:
            net, features = rig.learner.net(f"{agent}__critic"), seen[:, i]
        after[:, i] = net.memory.cell(net.trunk(features), memory[:, i])
        value[:, i] = net.moments.unscaled(net.body(after[:, i])[:, 0])
    return value, after


@pytest.mark.parametrize("name", BOTH)
def test_values_are_those_of_one_memory_unrolled_over_fragments_and_ended_with_trajectories(
    name, monkeypatch
):
    """Three fragments without an update in between, against the cells stepped by hand."""
    rig, found = Rig(name, Ragged, **GRU), []
    original = rig.learner.values

    def values(view):
        found.append(original(view))
        return found[-1]

    monkeypatch.setattr(rig.learner, "values", values)
    monkeypatch.setattr(rig.learner, "observe_targets", lambda batch: None)
    rollouts = [rig.rollout(16) for _ in range(3)]
    for rollout in rollouts:
        rig.learner.prepare(copy.deepcopy(rollout))
    with torch.no_grad():
        expected, finals = written_out(rig, rollouts)
    ours = torch.cat([part.unflatten(0, (17, 2))[:-1] for part in found[::2]])
    alive = torch.tensor(np.concatenate([rollout.views.alive[:-1] for rollout in rollouts]))
    torch.testing.assert_close(ours[alive], expected[alive], rtol=1e-4, atol=1e-5)
    cut = torch.tensor(np.concatenate([r.masks().last[*r.final_at.T] for r in rollouts]))
    torch.testing.assert_close(torch.cat(found[1::2])[cut], torch.stack(finals)[cut], rtol=1e-4, atol=1e-5)
    assert cut.sum() > 10


@pytest.mark.parametrize("name", BOTH)
def test_sequences_give_the_values_that_advantages_were_made_of(name):
    rig = Rig(name, Ragged, sharing={"odd": ["b"], "even": ["a", "c"]}, lambda_=0.0, gamma=0.0, **GRU)
    rig.learner.prepare(rig.rollout(24))
    batch = rig.learner.prepare(rig.rollout(24))
    again, rows = rig.learner.values(batch), singly(batch)
    alone = rig.learner.values(rows)
    torch.testing.assert_close(again[batch.alive], alone[batch.alive], rtol=0, atol=1e-6)


def singly(batch):
    """Return the same rows as single moments, each with its stored memory."""
    return type(batch)(**{**vars(batch), "length": 1, "fresh": None})


@pytest.mark.parametrize("name", BOTH)
def test_a_restored_learner_goes_on_with_the_memories_it_had(name):
    rig, other = (Rig(name, Ragged, seed=seed, **GRU) for seed in (1, 2))
    rig.learner.update_joint(rig.rollout(16))
    other.learner.set_state(rig.learner.get_state())
    rollout = rig.rollout(16)
    batches = [one.learner.prepare(copy.deepcopy(rollout)) for one in (rig, other)]
    assert batches[0].observations[0][CRITIC_MEMORY][:2].any()
    assert torch.equal(batches[0].targets, batches[1].targets)


def luck_error(name, seed, updates=100, **settings):
    """Return the mean squared error of values after the cue is gone, before the last step."""
    rig = Rig(name, Luck, seed=seed, gamma=1.0, lambda_=1.0, lr=5e-3, minibatch_size=None, **settings)
    for _ in range(updates):
        rig.learner.update_joint(rig.rollout(32))
    batch = rig.learner.prepare(rig.rollout(32))
    values = rig.learner.values(batch)
    return (values - batch.targets).square()[batch.observations[0][""][..., 1] > 0].mean().item()


@pytest.mark.nightly
@pytest.mark.parametrize("name", BOTH)
def test_critics_remember_what_the_reward_will_be(name):
    """0; 1/4 without memory."""
    assert luck_error(name, 1, gru=16) < 1 / 8
