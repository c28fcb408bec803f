"""COMA: the counterfactual advantage, on-policy TD(lambda) targets, the floor, small shares of a reward."""

import numpy as np
import pytest
import torch
from rigs import Rig

from algorithms.coma import CRITIC
from algorithms.maac import counterfactual_advantage
from algorithms.parts.distributions import CategoricalDistribution, FlooredDistribution
from tests.games.games import Constant, Game, Ragged


def test_the_advantage_is_eq_4_on_numbers_by_hand():
    """Q(s, (u^-a, .)) = (4, 1, -2) under the policy (1/2, 1/4, 1/4): the baseline is 7/4."""
    values = torch.tensor([[4.0, 1.0, -2.0]]).expand(3, 3)
    policy = CategoricalDistribution(torch.tensor([[2.0, 1.0, 1.0]]).log().expand(3, 3))
    advantages = counterfactual_advantage(values, policy, torch.arange(3))
    torch.testing.assert_close(advantages, torch.tensor([2.25, -0.75, -3.75]))
    assert (policy.log_probs[0].exp() * advantages).sum().item() == pytest.approx(0, abs=1e-6)


def q_of(rig, batch, actions):
    return rig.learner.net(CRITIC).q(batch, actions)


@pytest.mark.parametrize("sharing", ["none", "all", {"odd": ["b"], "even": ["a", "c"]}])
def test_an_agents_values_depend_on_the_others_actions_and_not_on_its_own(sharing):
    rig = Rig("coma", Ragged, sharing=sharing)
    batch = rig.learner.prepare(rig.rollout(20))
    taken = {name: actions.requires_grad_() for name, actions in batch.encoded_actions().items()}
    values = q_of(rig, batch, taken)
    for i in range(3):
        mine = batch.join(values)[:, i].sum()
        slopes = torch.autograd.grad(mine, list(taken.values()), retain_graph=True)
        felt = batch.join(dict(zip(taken, slopes, strict=True))).abs().amax((0, 2))
        assert felt[i] < 1e-6
        assert (felt[[j for j in range(3) if j != i]] > 1e-4).all()


@pytest.mark.parametrize("reward", ["sum", "mean"])
def test_targets_are_sums_of_n_step_returns_written_out(reward):
    """y = (1 - lambda) sum of lambda^(n - 1) G^(n) over arrivals, deaths, cuts and failures."""
    rig = Rig("coma", Ragged, sharing="all", gamma=0.9, lambda_=0.7, team_reward=reward, reward_scale=2.0)
    for p in rig.learner.net(CRITIC).target_q.parameters():
        torch.nn.init.normal_(p, std=0.5)
    rollout, seen = rig.rollout(40), []
    value = rig.learner.team_value
    rig.learner.team_value = lambda *args: seen.append(value(*args)) or seen[-1]
    batch = rig.learner.prepare(rollout)
    values = torch.cat([seen[0].unflatten(0, (40, 2)), seen[1][None]]).double().numpy()
    final = dict(zip(map(tuple, rollout.final_at.tolist()), seen[2].tolist(), strict=True))
    alive, masks = rollout.views.alive, rollout.masks()
    targets, checked = batch.targets.unflatten(0, (40, 2)), 0
    for b in range(2):
        for start in np.flatnonzero(alive[:-1, b].any(-1)):
            returns, total, t = [], 0.0, int(start)
            while True:
                there = alive[t, b]
                pay = rollout.rewards[t, b][there].sum() / (there.sum() if reward == "mean" else 1)
                total += 0.9 ** (t - start) * 2 * pay
                cut = (t, b) in final
                ends = cut or rollout.reset[t, b] or not alive[t + 1, b].any()
                counts = rollout.final.alive[list(final).index((t, b))].any() if cut else not ends
                following = (final[t, b] if cut else values[t + 1, b]) if counts else 0.0
                returns.append(total + 0.9 ** (t + 1 - start) * following)
                if ends or t == 39:
                    break
                t += 1
            weights = [0.3 * 0.7**n for n in range(len(returns) - 1)] + [0.7 ** (len(returns) - 1)]
            expected = float(np.dot(weights, returns))
            for i in np.flatnonzero(alive[start, b]):
                assert targets[start, b, i].item() == pytest.approx(expected, rel=1e-4, abs=1e-4)
                checked += 1
    assert checked > 50
    assert rollout.failed.any()
    assert masks.last[:-1].any()
    assert (batch.targets[~batch.alive] == 0).all()


def test_the_policies_that_learn_are_those_that_acted():
    """Probabilities have the floor of the fragment, whether or not an episode was cut in it."""
    rig = Rig("coma", Ragged, sharing="all", epsilon=(0.5, 0.1), epsilon_steps=100)
    rig.learner.env_steps = 50
    rollout = rig.rollout(16, **rig.config.exploration(50)._asdict())
    rig.learner.env_steps += rollout.env_steps()
    batch = rig.learner.prepare(rollout)
    assert rig.learner.epsilon == pytest.approx(0.3)
    ((group, own),) = batch.groups()
    again = rig.learner.distribution(group.id, own).log_prob(own.actions)
    torch.testing.assert_close(again[own.alive], own.log_prob[own.alive], rtol=0, atol=1e-6)
    assert again.exp().min() >= 0.3 / 3 - 1e-6


def test_the_floor_mixes_a_softmax_with_allowed_actions():
    logits, mask = torch.tensor([[1.0, 2.0, 3.0]]), torch.tensor([[True, False, True]])
    policy = FlooredDistribution(logits, mask, 0.2)
    plain = torch.tensor([[1.0, 3.0]]).softmax(-1)
    expected = torch.tensor([[0.8 * plain[0, 0] + 0.1, 0.0, 0.8 * plain[0, 1] + 0.1]])
    torch.testing.assert_close(policy.log_probs.exp(), expected)
    assert torch.isfinite(policy.entropy())
    assert (policy.sample(torch.Generator().manual_seed(0)) != 1).all()


def test_the_target_critic_follows_by_tau_after_each_rollout():
    rig = Rig("coma", Constant, tau=0.25)
    before = rig.weights()[CRITIC]
    rig.learner.update_joint(rig.rollout(16))
    after = rig.weights()[CRITIC]
    for key in (k for k in before if k.startswith("target_")):
        expected = 0.75 * before[key] + 0.25 * after[key.removeprefix("target_")]
        torch.testing.assert_close(after[key], expected)


class Shares(Game):
    """Each of 12 agents gets the sum of 0.6^i over the agents i that play their good action, one of four.

    The last agents' shares are 1/275 of the first's, and drown in the noise of exploring teammates. The score
    is the share of agents that play their good action greedily.
    """

    def __init__(self, config=None):
        super().__init__(agents=12, actions=4)

    def reward(self, actions):
        return [float(sum(0.6**i * (action == i % 4) for i, action in enumerate(actions)))] * 12


SHARES = {"lr": 1e-2, "team_reward": "mean", "epsilon": (0.5, 0.5), "critic_steps": 16}


def shares_score(seed, name="coma", steps=4_096):
    """Return the share of agents that found their good action."""
    rig = Rig(name, Shares, seed=seed, gamma=0.0, **(SHARES if name == "coma" else {"lr": SHARES["lr"]}))
    for done in range(0, steps, 64):
        rig.learner.update_joint(rig.rollout(32, **rig.config.exploration(done)._asdict()))
    return np.mean(rig.rollout(1, explore=False).actions[0][0, 0] == np.arange(12) % 4)


@pytest.mark.nightly
def test_small_shares_of_a_noisy_reward_are_found():
    """1; without the counterfactual baseline 0.69; `centralised_v` finds them, too."""
    assert shares_score(1) > (1 + 0.75) / 2
