"""MAVEN: latents of whole episodes, mutual information, the latents' policy, and committed exploration."""

from typing import Any

import numpy as np
import pytest
import torch
from gymnasium.spaces import Box, Discrete
from ray.rllib.env.multi_agent_env import MultiAgentEnv
from rigs import Rig, replayed

from algorithms.joint.adapter import JointVector
from algorithms.joint.batch import JointView
from algorithms.joint.env import LATENT
from algorithms.maven import (
    DISCRIMINATOR,
    EpisodeReturns,
    MAVENModule,
    latent_of,
)
from algorithms.qmix import MIXER
from tests.games.games import Constant, Cues, Ragged, TwoStep

REPLAY = {"learning_starts": 1, "capacity": 1000, "batch_size": 32}
STEPS = 5


@pytest.mark.parametrize("sharing", ["none", "all"])
def test_a_team_has_one_latent_for_each_episode(sharing):
    rig = Rig("maven", Ragged, sharing=sharing, latents=5, **REPLAY)
    rollout = rig.rollout(60, epsilon=1.0)
    latents = rollout.views.observations[0][LATENT]
    assert (latents.sum(-1) == 1).all()
    assert (latents == latents[:, :, :1]).all()
    for b in range(2):
        changed = (latents[1:, b, 0] != latents[:-1, b, 0]).any(-1)
        assert not (changed & ~rollout.reset[:, b]).any()
    assert len(np.unique(latents.argmax(-1))) > 2


def test_latents_do_not_depend_on_the_number_of_environments_and_are_restored():
    few, many, other = (
        Rig("maven", JointVector(lambda b: Ragged({}), count), latents=5, **REPLAY) for count in (2, 5, 2)
    )
    begun = [rig.rollout(5, epsilon=1.0).views.observations[0][LATENT][0] for rig in (few, many)]
    assert np.array_equal(begun[0], begun[1][:2])
    assert len(np.unique(begun[1][:, 0], axis=0)) > 1
    other.sampler.set_state(few.sampler.get_state())
    first, second = (rig.rollout(20, epsilon=1.0) for rig in (few, other))
    assert np.array_equal(first.views.observations[0][LATENT], second.views.observations[0][LATENT])
    assert first.reset.any()


def test_latents_are_drawn_from_their_policy_at_the_beginning():
    """The logits are sums over the active agents' shares; frequencies follow the softmax."""
    rig = Rig("maven", Ragged, sharing={"odd": ["b"], "even": ["a", "c"]}, latents=3, **REPLAY)
    nets = [rig.learner.net(group.id) for group in rig.spec.groups]
    for net in nets:
        torch.nn.init.normal_(net.latent.body[-1].weight, std=2.0)
    view = JointView.of(rig.spec, rig.rollout(20, epsilon=1.0).views)[0]
    views = [view.view(group) for group in rig.spec.groups]
    policy = MAVENModule.latents(nets, views)
    for k in range(2):
        logits = torch.zeros(3)
        for net, own in zip(nets, views, strict=True):
            shares = net.latent.body(net.latent.encoder(own.observations))
            logits += sum(shares[k, i] for i in range(own.alive.shape[1]) if own.alive[k, i])
        torch.testing.assert_close(policy.log_probs[k], logits.log_softmax(-1))
    generator, counts = torch.Generator().manual_seed(0), torch.zeros(2, 3)
    for _ in range(2_000):
        drawn = MAVENModule.begin_episode(nets, views, generator)
        assert torch.equal(drawn[0][:, 0], drawn[1][:, 0])
        counts += drawn[0][:, 0]
    torch.testing.assert_close(counts / 2_000, policy.log_probs.exp(), rtol=0, atol=0.04)


def test_returns_are_those_of_whole_episodes_over_fragments_and_failures():
    rig = Rig("maven", Ragged, **REPLAY)
    episodes, found, expected = EpisodeReturns(), [], []
    begun: list[Any] = [None, None]
    total = np.zeros(2)
    for _ in range(12):
        rollout = rig.rollout(8, epsilon=1.0)
        starts, returns = episodes.add(rollout, rollout.rewards.sum(-1))
        found += [
            (s.observations[0][""].tolist(), s.alive.tolist(), r)
            for s, r in zip(starts, returns, strict=True)
        ]
        for b in range(2):
            for t in range(8):
                if begun[b] is None:
                    begun[b] = (
                        [rollout.views.observations[0][""][t, b].tolist()],
                        [rollout.views.alive[t, b].tolist()],
                    )
                total[b] += rollout.rewards[t, b].sum()
                if rollout.reset[t, b]:
                    if not rollout.failed[t, b]:
                        expected.append((*begun[b], pytest.approx(total[b], abs=1e-4)))
                    begun[b], total[b] = None, 0.0
    assert len(found) == len(expected) > 10
    assert all(each in expected for each in found)


def test_the_discriminator_does_not_see_the_latent_and_the_mixer_does():
    for game in (TwoStep, Cues):  # with a state, and with joint observations
        rig = Rig("maven", game, latents=4, **REPLAY)
        batch = replayed(rig, epsilon=1.0)
        encoder, mixer = rig.learner.net(DISCRIMINATOR).encoder, rig.learner.net(MIXER).mixer.encoder
        state, mixed = encoder(batch), mixer(batch)
        latents = latent_of(batch).clone()
        for leaves in batch.observations:
            leaves[LATENT][:] = leaves[LATENT].roll(1, -1)
        assert torch.equal(encoder(batch), state)
        assert torch.equal(latent_of(batch), latents.roll(1, -1))
        assert not torch.equal(mixer(batch), mixed)


def test_the_penalty_is_the_surprise_at_the_latent_written_out():
    rig = Rig("maven", Ragged, sharing="all", latents=4, lambda_mi=0.5, **REPLAY)
    batch = replayed(rig, 40, epsilon=1.0)
    ((group, own),) = batch.groups()
    values = {group.id: rig.learner.net(group.id).policy(own)}
    discriminator, total, count = rig.learner.net(DISCRIMINATOR), 0.0, 0
    state = discriminator.encoder(batch)
    for m in range(len(batch)):
        policies = [own.alive[m, i] * values[group.id][m, i].softmax(-1) for i in range(3)]
        guess = discriminator.body(torch.cat([state[m], *policies])).softmax(-1)
        if batch.alive[m].any():
            total, count = total - guess[latent_of(batch)[m].argmax()].log().item(), count + 1
    found = rig.learner.penalty(batch, values).item()
    assert found == pytest.approx(0.5 * total / count, rel=1e-4)


def test_the_latents_policy_follows_the_return():
    """grad log pi_z(z) R with R standardised: equal shares at first, then the latent that pays."""
    rig = Rig("maven", Constant, latents=4, lr=1e-2, latent_entropy=0.0, **REPLAY)
    rig.learner.update_joint(rig.rollout(8, epsilon=1.0))
    first = JointView.of(rig.spec, rig.rollout(20, epsilon=1.0).views).flat()
    returns = latent_of(first)[:, 2]
    for _ in range(60):
        rig.learner.improve_latents(first, returns)
    views = [first.view(group) for group in rig.spec.groups]
    policy = MAVENModule.latents([rig.learner.net(g.id) for g in rig.spec.groups], views)
    assert (policy.log_probs.exp().mean(0)[2]).item() > 0.9


class Committed(MultiAgentEnv):
    """The paper's m-step matrix game, m = 5, whose first and last steps need both agents.

    The first joint action chooses a branch: (0, 0) or (1, 1); others end the episode. Each step that repeats
    it pays 1, others end the episode. The last step of the branch (0, 0) pays 4 for (1, 1), else 1. Best:
    m + 3. The other branch pays m.
    """

    def __init__(self, config=None):
        super().__init__()
        self.possible_agents = self.agents = ["a", "b"]
        self.observation_spaces = {a: Box(0.0, 1.0, (STEPS + 3,), np.float32) for a in self.agents}
        self.action_spaces = {a: Discrete(2) for a in self.agents}

    def reset(self, *, seed=None, options=None) -> Any:
        self.t, self.branch = 0, 2
        return self._see(), {}

    def step(self, action_dict) -> Any:
        first, second = (int(action_dict[a]) for a in self.agents)
        if self.t == 0 and first == second:
            self.branch = first
        reward = float(first == second == self.branch)
        self.t += 1
        if self.t == STEPS and self.branch == 0:
            reward = 4.0 if first == second == 1 else 1.0
        over = self.t == STEPS or not reward
        return self._see(), dict.fromkeys(self.agents, reward / 2), {"__all__": over}, {"__all__": False}, {}

    def _see(self):
        seen = np.zeros(STEPS + 3, np.float32)
        seen[min(self.t, STEPS - 1)] = seen[STEPS + self.branch] = 1
        return dict.fromkeys(self.agents, seen)


COMMITTED = {
    "lr": 2e-3,
    "learning_starts": 64,
    "updates_per_step": 0.25,
    "batch_size": 64,
    "capacity": 10_000,
}
COMMITTED |= {"epsilon": (1.0, 0.01), "epsilon_steps": 200, "tau": 0.02}


def committed_score(seed, name="maven", steps=8_000, episodes=32, **settings):
    """Return the team's mean return of greedy episodes."""
    rig = Rig(name, Committed, seed=seed, **{**COMMITTED, **settings})
    rig.learn(steps)
    return float(np.mean([e.returns.sum() for e in rig.greedy_episodes(episodes)]))


@pytest.mark.nightly
def test_a_team_that_commits_finds_the_far_optimum():
    """m + 3 = 8; the other branch pays 5."""
    assert committed_score(1) > (8 + 5) / 2
