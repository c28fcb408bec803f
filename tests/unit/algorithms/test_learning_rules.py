"""Gradients reach what the equations name and nothing else; special cases equal simpler algorithms."""

import copy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from gymnasium.spaces import Box
from rigs import EVERY, OFF_POLICY, PLAYING, SHARED, Rig, cases, known, moved, replayed, takes

from algorithms.joint.stacking import StackedGroups
from algorithms.maac import CRITIC
from tests.games.games import Cues, Game, Ragged, Target, TwoStep

REPLAY = {"learning_starts": 1, "capacity": 1000, "batch_size": 32, "updates_per_step": 0.05}


def settings_of(name):
    return known(name, REPLAY)


def update(rig, rollout):
    before = rig.weights()
    rig.learner.update_joint(rollout)
    return before, rig.weights()


@pytest.mark.parametrize("name", EVERY)
def test_a_step_moves_exactly_the_named_networks(name, monkeypatch):
    rig = Rig(name, Cues, **settings_of(name))
    steps = []
    original = type(rig.learner).step_optimizer

    def watched(self, loss, *modules):
        before = rig.weights()
        original(self, loss, *modules)
        steps.append((moved(before, rig.weights()), set(modules)))

    monkeypatch.setattr(type(rig.learner), "step_optimizer", watched)
    update(rig, rig.rollout(epsilon=1.0))
    assert steps
    for found, named in steps:
        assert found == named
    assert set().union(*(named for _, named in steps)) == set(rig.weights())


@pytest.mark.parametrize("name", ["ppo", "dqn"])
def test_independent_learners_feel_only_their_own_rewards(name):
    rig, other = Rig(name, Cues, **settings_of(name)), Rig(name, Cues, **settings_of(name))
    rollout = rig.rollout(epsilon=1.0)
    changed = copy.deepcopy(rollout)
    changed.rewards[..., 1] += np.linspace(-3, 3, 32, dtype=np.float32)[:, None]
    update(rig, rollout)
    update(other, changed)
    differing = moved(rig.weights(), other.weights())
    assert differing
    assert all(module.startswith("agent_1") for module in differing)


@pytest.mark.parametrize("name", SHARED)
def test_planted_numbers_in_dead_rows_change_no_weight(name):
    settings = {**settings_of(name), **known(name, {"consensus": False})}
    rig, other = (Rig(name, Ragged, sharing="all", **settings) for _ in range(2))
    rollout = rig.rollout(48, epsilon=1.0)
    planted = copy.deepcopy(rollout)
    dead = ~planted.views.alive
    planted.views.observations[0][""][dead] = 77.0
    planted.rewards[dead[:-1]] = 1e6
    final_dead = ~planted.final.alive
    planted.final.observations[0][""][final_dead] = -55.0
    assert dead.any()
    update(rig, rollout)
    update(other, planted)
    assert moved(rig.weights(), other.weights()) == set()


def test_a2c_is_ppo_with_one_minibatch():
    a2c = Rig("a2c", Cues, lr=1e-3)
    ppo = Rig("ppo", Cues, lr=1e-3, epochs=1, minibatch_size=None)
    rollout = a2c.rollout()
    update(a2c, rollout)
    update(ppo, rollout)
    first, second = a2c.weights(), ppo.weights()
    for module, weights in first.items():
        for name, weight in weights.items():
            torch.testing.assert_close(weight, second[module][name], rtol=0, atol=1e-6)


class Alone(Target):
    """`Target` with one agent."""

    def __init__(self, config=None):
        super().__init__(config)
        self.possible_agents = self.agents = ["agent_0"]


def test_maddpg_with_one_agent_is_ddpg():
    rig = Rig("maddpg", Alone, logit_penalty=0.0, grad_clip=None, lr=1e-3, tau=0.01, **REPLAY)
    batch = replayed(rig, noise=0.3)
    actor, critic = rig.learner.net("agent_0"), rig.learner.net("agent_0__critic")
    mine = copy.deepcopy((actor.actor, actor.target_actor, critic.q, critic.target_q))
    pi, target_pi, q, target_q = mine
    x, y = batch.observations[0][""], batch.next.observations[0][""]

    def value(net, seen, there, action):
        joint = torch.cat([seen.flatten(1), there.float()], -1)
        return net.rest(net.see(joint) + net.act(action.flatten(1)) + net.place[0])

    critic_optimizer = torch.optim.Adam(q.parameters(), lr=1e-3, eps=1e-5)
    actor_optimizer = torch.optim.Adam(pi.parameters(), lr=1e-3, eps=1e-5)
    with torch.no_grad():
        following = value(target_q, y, batch.next.alive, target_pi({"": y}).tanh())
        target = batch.rewards + rig.learner.gamma * batch.bootstrap * following
    critic_optimizer.zero_grad()
    (value(q, x, batch.alive, batch.actions[0]) - target).square().mean().backward()
    critic_optimizer.step()
    actor_optimizer.zero_grad()
    (-value(q, x, batch.alive, pi({"": x}).tanh()).mean()).backward()
    actor_optimizer.step()
    with torch.no_grad():
        for own, source in ((target_pi, pi), (target_q, q)):
            for a, b in zip(own.parameters(), source.parameters(), strict=True):
                a.lerp_(b, 0.01)

    rig.learner.update_minibatch(batch)
    for theirs, ours in zip((actor.actor, actor.target_actor, critic.q, critic.target_q), mine, strict=True):
        for a, b in zip(theirs.parameters(), ours.parameters(), strict=True):
            torch.testing.assert_close(a, b, rtol=1e-4, atol=1e-6)


def test_the_mixer_is_monotone_and_depends_on_the_state():
    rig = Rig("qmix", TwoStep, **REPLAY)
    mixer = rig.learner.net("team__mixer").mixer
    batch = replayed(rig, 50, epsilon=1.0)
    values = torch.randn(len(batch), 2, requires_grad=True)
    view, other, far = (replace(batch, state=s) for s in (batch.state, -batch.state, 100 * batch.state))
    (slope,) = torch.autograd.grad(mixer(values, view).sum(), values)
    assert (slope >= 0).all()
    assert (slope > 0).any()
    assert (mixer(values, view) != mixer(values, other)).any()
    torch.testing.assert_close(mixer(values, view), mixer(values, far), rtol=1e-3, atol=1e-3)


class Gifts(Game):
    """An action mask in the observation; illegal actions would be paid for."""

    def __init__(self, config=None):
        super().__init__(agents=2, actions=3)
        from gymnasium.spaces import Dict

        spaces: dict[str, Any] = {
            "observations": Box(-1.0, 1.0, (2,), np.float32),
            "action_mask": Box(0, 1, (3,), np.int8),
        }
        self.observation_spaces = {a: Dict(spaces) for a in self.agents}

    def observe(self):  # type: ignore[override] - a Dict observation
        self.action_mask = (self.rng.random((2, 3)) < 0.5) | np.eye(3, dtype=bool)[
            self.rng.integers(3, size=2)
        ]
        return {
            a: {"observations": np.zeros(2, np.float32), "action_mask": mask.astype(np.int8)}
            for a, mask in zip(self.agents, self.action_mask, strict=True)
        }

    def reward(self, actions):
        return [float(not mask[action]) for action, mask in zip(actions, self.action_mask, strict=True)]


@pytest.mark.parametrize("name", EVERY)
def test_illegal_actions_are_never_taken(name):
    rig = Rig(name, Gifts, **settings_of(name))
    for epsilon in (1.0, 0.3, 0.0):
        rollout = rig.rollout(32, epsilon=epsilon)
        assert rollout.rewards.sum() == 0
        rig.learner.update_joint(rollout)
    assert all(torch.isfinite(w).all() for part in rig.weights().values() for w in part.values())


def test_networks_evaluated_as_one_learn_like_separate_ones():
    """Over deaths and arrivals, with groups of which nobody is there in some minibatches."""
    settings = {"normalize_values": True, "minibatch_size": 3, "epochs": 2}
    one, several = (Rig("ppo", Ragged, **settings) for _ in range(2))
    assert [stack.is_stacked for stack in one.learner.stacked_policies] == [True]
    several.learner.stacked_policies = several.learner.stacked_values = tuple(
        StackedGroups((group,), group) for group in several.spec.groups
    )
    rollout = one.rollout(30)
    for rig in (one, several):
        rig.learner.update_joint(rollout)
    first, second = one.weights(), several.weights()
    for module, weights in first.items():
        for name, weight in weights.items():
            torch.testing.assert_close(weight, second[module][name], rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    "name", cases([n for n in PLAYING if n != "networked_q" and takes(n, sharing="none")])
)
def test_networks_of_groups_of_which_nobody_is_there_do_not_move(name):
    """Adam's momentum would move them; in networked Q every node takes part in every fit."""
    settings = {"sharing": "none", **settings_of(name)}
    rig = Rig(name, Ragged, **settings)
    rig.learner.update_joint(rig.rollout(32, epsilon=1.0))
    rollout = rig.rollout(32, epsilon=1.0)
    batch = replayed(rig, 32, 200, epsilon=1.0) if name in OFF_POLICY else rig.learner.prepare(rollout)
    before = trained_weights(rig)
    rig.learner.update_minibatch(without(1, batch))
    after = trained_weights(rig)
    for module in (m for m in before if m.split("__")[0] in "abc"):
        still = all(torch.equal(before[module][k], after[module][k]) for k in before[module])
        assert still == module.startswith("b"), module
    if name == "maac":
        kept = {k for k, v in after[CRITIC].items() if torch.equal(v, before[CRITIC][k])}
        assert kept == {k for k in after[CRITIC] if k.startswith("q.embeddings.1.")}


def without(column, batch):
    """Return the rows without an agent; of sequences all rows, in which it is not active."""
    if batch.length == 1:
        return batch[~batch.alive[:, column]]
    alive = batch.alive.clone()
    alive[:, column] = False
    return replace(batch, alive=alive)


def trained_weights(rig):
    """Return the weights but for target networks, which follow at all times."""
    return {
        module: {k: v for k, v in part.items() if not k.startswith("target_")}
        for module, part in rig.weights().items()
    }


def _greedy():
    from algorithms.parts.distributions import Exploration

    return Exploration(explore=False), torch.Generator()


@pytest.mark.parametrize(("name", "sharing"), [("ppo", "none"), ("ppo", "all"), ("dqn", "none")])
def test_stacked_policies_act_like_separate_ones(name, sharing):
    rig = Rig(name, Cues, sharing=sharing, **settings_of(name))
    rig.learner.update_joint(rig.rollout(epsilon=1.0))
    rig.policies.refresh()
    view = rig.sampler._now
    assert rig.policies._stacked[0] is not None
    stacked = rig.policies._act(0, view, *_greedy())
    rig.policies._stacked = [None]
    separate = rig.policies._act(0, view, *_greedy())
    torch.testing.assert_close(stacked.distribution, separate.distribution, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("name", EVERY)
def test_a_restored_learner_continues_exactly(name):
    rig, other = (Rig(name, Cues, seed=seed, **settings_of(name)) for seed in (1, 2))
    rig.learner.update_joint(rig.rollout(24, epsilon=1.0))  # ends in mid-episode
    other.learner.set_state(rig.learner.get_state())
    for _ in range(2):
        rollout = rig.rollout(24, epsilon=1.0)
        for one in (rig, other):
            one.learner.update_joint(rollout)
    assert moved(rig.weights(), other.weights()) == set()
