"""QTRAN: its constraints on numbers by hand, its losses, and the paper's matrix game."""

from typing import Any

import numpy as np
import pytest
import torch
from gymnasium.spaces import Box, Discrete
from ray.rllib.env.multi_agent_env import MultiAgentEnv
from rigs import Rig, replayed

from algorithms.joint.batch import encode
from algorithms.maac import of_actions
from algorithms.qtran import JOINT
from tests.games.games import Ragged

REPLAY = {"learning_starts": 1, "capacity": 1000, "batch_size": 32}
PAYOFFS = ((8.0, -12.0, -12.0), (-12.0, 0.0, 0.0), (-12.0, 0.0, 0.0))
"""Table 1 of Son et al. 2019: not monotonic in the agents' values."""


class Matrix(MultiAgentEnv):
    """One step of the paper's matrix game; each agent gets half of the payoff."""

    def __init__(self, config=None):
        super().__init__()
        self.possible_agents = self.agents = ["a", "b"]
        self.observation_spaces = {a: Box(0.0, 1.0, (1,), np.float32) for a in self.agents}
        self.action_spaces = {a: Discrete(3) for a in self.agents}

    def reset(self, *, seed=None, options=None) -> Any:
        return {a: np.ones(1, np.float32) for a in self.agents}, {}

    def step(self, action_dict) -> Any:
        reward = PAYOFFS[int(action_dict["a"])][int(action_dict["b"])] / 2
        ends, cuts = {"__all__": True}, {"__all__": False}
        return self.reset()[0], dict.fromkeys(self.agents, reward), ends, cuts, {}


class Table(torch.nn.Module):
    """The payoffs as joint value: of the joint action, or of each agent's actions beside the other's."""

    def __init__(self, variant):
        super().__init__()
        self.alt, self.payoffs = variant == "alt", torch.tensor(PAYOFFS)

    def forward(self, view, actions):
        first, second = actions["a"][:, 0], actions["b"][:, 0]
        rows, columns = first @ self.payoffs, second @ self.payoffs.T
        if self.alt:
            return {"a": columns[:, None], "b": rows[:, None]}
        return (rows * second).sum(-1, keepdim=True)


@pytest.mark.parametrize(
    ("variant", "values", "taken", "opt", "nopt"),
    [
        ("base", (4, 1, 0), (0, 0), 0, 0),  # 4 + 4 - 8 = 0
        ("base", (4, 1, 0), (1, 1), 0, 0),  # 1 + 1 - 0 = 2: no fault
        ("base", (4, -3, -3), (1, 1), 0, 36),  # -3 - 3 - 0 = -6
        ("base", (5, 1, 0), (0, 1), 4, 0),  # 5 + 5 - 8 = 2 at the best; 5 + 1 + 12 where taken
        ("base", (0, 1, 0), (0, 0), 4, 64),  # 1 + 1 - 0 = 2 at the best; 0 + 0 - 8 where taken
        ("alt", (4, 1, 0), (1, 1), 0, 1),  # beside the other's 1: 17, 2 and 1
        ("alt", (4, -3, -3), (1, 1), 0, 36),  # 13, -6 and -6
        ("alt", (4, 0, 0), (2, 0), 0, 0),  # beside 2: 16, 0 and 0; beside 0: 0, 16 and 16
        ("alt", (5, 1, 0), (0, 1), 4, (4 + 1) / 2),  # beside 0: 2, 18, 17; beside 1: 18, 2 and 1
    ],
)
def test_the_constraints_are_the_papers_on_numbers_by_hand(variant, values, taken, opt, nopt, monkeypatch):
    """D = Q_a + Q_b - Q_jt + V with V = 0 at the agents' best actions, and where they acted."""
    rig = Rig("qtran", Matrix, variant=variant, gamma=0.0, **REPLAY)
    batch, learner = replayed(rig, 4, 1, epsilon=1.0), rig.learner
    for name, action in zip("ab", taken, strict=True):
        monkeypatch.setattr(
            learner.net(name), "policy", lambda view: torch.tensor(values).float().expand(1, 1, 3)
        )
        batch.actions[0][:, "ab".index(name)] = action
    batch.rewards[:] = PAYOFFS[taken[0]][taken[1]] / 2
    net, found = learner.net(JOINT), {}
    net.q = net.target_q = Table(variant)
    for p in net.v.parameters():
        torch.nn.init.zeros_(p)
    monkeypatch.setattr(learner, "log", lambda module, name, value: found.update({name: value.item()}))
    monkeypatch.setattr(learner, "step_optimizer", lambda loss, *names: None)
    monkeypatch.setattr(learner, "polyak_update", lambda *names, tau: None)
    learner.update_minibatch(batch)
    assert found == {"td_loss": 0, "opt_loss": pytest.approx(opt), "nopt_loss": pytest.approx(nopt)}


@pytest.mark.parametrize("variant", ["base", "alt"])
def test_the_temporal_difference_asks_the_target_networks_at_the_agents_best_actions(variant, monkeypatch):
    settings = {"sharing": "all", "double": False, "gamma": 0.9, "reward_scale": 2.0}
    rig = Rig("qtran", Ragged, variant=variant, **settings, **REPLAY)
    net, own = rig.learner.net(JOINT), rig.learner.net("shared")
    for target in (net.target_q, own.target_q):
        for p in target.parameters():
            torch.nn.init.normal_(p, std=0.5)
    batch, found = replayed(rig, 60, epsilon=1.0), {}
    monkeypatch.setattr(rig.learner, "log", lambda module, name, value: found.update({name: value.item()}))
    monkeypatch.setattr(rig.learner, "step_optimizer", lambda loss, *names: None)
    monkeypatch.setattr(rig.learner, "polyak_update", lambda *names, tau: None)
    rig.learner.update_minibatch(batch)
    following, (group,) = batch.next, rig.spec.groups
    with torch.no_grad():
        best = own.target_q(following.observations[0]).argmax(-1)
        chosen = {group.id: encode(group, best) * following.alive[..., None]}
        value, estimate = net.target_q(following, chosen), net.q(batch, batch.encoded_actions())
        if variant == "alt":
            there = following.alive.sum(-1).clamp(min=1)
            value = (of_actions(value[group.id], best) * following.alive).sum(-1) / there
            estimate, counted = of_actions(estimate[group.id], batch.actions[0]), batch.alive
        else:
            value, counted = value[:, 0] * following.alive.any(-1), batch.alive.any(-1)[:, None]
        target = 2 * (batch.rewards * batch.alive).sum(-1) + 0.9 * value
    expected = (estimate - target[:, None]).square()[counted].mean().item()
    assert found["td_loss"] == pytest.approx(expected, rel=1e-5)


def matrix_score(seed, name="qtran", steps=4_000, **settings):
    """Return the payoff of the joint action that greedy agents play after learning from random ones."""
    learn = {"learning_starts": 200, "updates_per_step": 0.5, "batch_size": 64}
    rig = Rig(name, Matrix, seed=seed, lr=3e-3, **learn, **settings)
    for _ in range(0, steps, 16):
        rig.learner.update_joint(rig.rollout(8, epsilon=1.0))
    return 2 * rig.rollout(1, explore=False).rewards[0, 0, 0]


@pytest.mark.nightly
@pytest.mark.parametrize("variant", ["base", "alt"])
def test_qtran_finds_the_optimum_of_a_matrix_that_is_not_monotonic(variant):
    assert matrix_score(1, variant=variant) == 8
