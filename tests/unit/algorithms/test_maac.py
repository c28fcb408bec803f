"""MAAC: what the critic sees, what its baseline is, whose policies its target asks, and a game."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from rigs import Rig, replayed

from algorithms.maac import CRITIC, of_actions
from algorithms.parts.attention import attend
from algorithms.parts.distributions import CategoricalDistribution
from tests.games.games import Product, Ragged

REPLAY = {"learning_starts": 1, "capacity": 1000, "batch_size": 32}


def test_attention_is_a_softmax_over_the_other_living_agents():
    rng = np.random.default_rng(0)
    q, k, v = rng.standard_normal((3, 20, 4, 2, 3))
    alive = rng.random((20, 4)) < 0.6
    found = attend(*(torch.tensor(x) for x in (q, k, v, alive))).numpy()
    for m in range(20):
        for i in range(4):
            heard = [j for j in range(4) if j != i and alive[m, j]]
            for h in range(2):
                score = np.exp([q[m, i, h] @ k[m, j, h] / np.sqrt(3) for j in heard])
                expected = sum((s / score.sum() * v[m, j, h] for s, j in zip(score, heard, strict=True)), 0)
                np.testing.assert_allclose(found[m, i, h], expected + np.zeros(3), rtol=0, atol=1e-12)


@pytest.mark.parametrize("sharing", ["none", "all"])
def test_values_depend_on_the_own_observation_and_the_living_others_observations_and_actions(sharing):
    """And neither query nor value on the own action: section 3.3 of the paper."""
    rig = Rig("maac", Ragged, sharing=sharing, **REPLAY)
    batch = replayed(rig, 60)
    seen = batch.observations[0][""].clone().requires_grad_()
    batch = replace(batch, observations=({"": seen},))
    taken = {g: torch.rand_like(a).requires_grad_() for g, a in batch.encoded_actions().items()}
    values = batch.join(rig.learner.net(CRITIC).q(batch, taken))
    lonely = batch.alive.sum(1) == 1
    assert lonely.any()
    for i in range(3):
        slopes = torch.autograd.grad(values[:, i].sum(), [seen, *taken.values()], retain_graph=True)
        by_seen = (slopes[0] != 0).any(-1)
        by_action = batch.join(dict(zip(taken, slopes[1:], strict=True))).abs().sum(-1) != 0
        others = batch.alive.clone()
        others[:, i] = False
        assert torch.equal(by_action, others)
        others[:, i] = True
        assert torch.equal(by_seen, others)


def test_the_critics_target_asks_the_target_policies_and_is_soft(monkeypatch):
    """Equation 7 written out: r + gamma (Q'(o', a') - alpha log pi'(a')), a' from the target policies."""
    rig = Rig("maac", Ragged, sharing="all", alpha=0.3, gamma=0.9, **REPLAY)
    batch, learner = replayed(rig, 60), rig.learner
    net, critic = learner.net("shared"), learner.net(CRITIC)
    for p in [*net.target_actor.parameters(), *critic.target_q.parameters()]:
        torch.nn.init.normal_(p, std=0.5)
    state, losses = learner.generator.get_state(), []
    monkeypatch.setattr(
        learner, "step_optimizer", lambda loss, *modules: losses.append((loss.item(), modules))
    )
    learner.fit_critic(batch)
    learner.generator.set_state(state)
    with torch.no_grad():
        policy = CategoricalDistribution(net.target_actor(batch.next.observations[0]))
        actions = policy.sample(learner.generator)
        one_hot = torch.nn.functional.one_hot(actions, 3).float()
        following = of_actions(critic.target_q(batch.next, {"shared": one_hot})["shared"], actions)
        soft = following - 0.3 * policy.log_prob(actions)
        target = batch.rewards + 0.9 * batch.bootstrap * soft
        value = of_actions(critic.q(batch, batch.encoded_actions())["shared"], batch.actions[0])
        expected = (value - target).square()[batch.alive].mean().item()
    assert losses == [(pytest.approx(expected, rel=1e-5), (CRITIC,))]


def product_score(seed):
    """Return the mean greedy return per step of each agent, (N,), after learning."""
    recipe = {"lr": 3e-3, "learning_starts": 200, "updates_per_step": 0.5, "batch_size": 128, "gamma": 0.5}
    rig = Rig("maac", Product, seed=seed, **recipe)
    rig.learn(4_000)
    rollout = rig.rollout(200, explore=False)
    return rollout.rewards.mean((0, 1))


@pytest.mark.nightly
def test_the_product_of_hits_is_solved():
    """1.0; misaligned agents 0.33, wrong action slot 0.22."""
    assert (product_score(1) > (1 + 0.33) / 2).all()
