"""HAPPO: the ratios that compound over a random order, one agent alone, and drivers that yield."""

import copy

import pytest
import torch
from rigs import Rig, per_step

from tests.games.games import Cues, Ragged
from tests.games.yielding import Yielding

STEEP = {"lr": 3e-2, "epochs": 20, "clip": 5.0, "minibatch_size": None, "gamma": 0.0, "entropy_coeff": 0.0}
"""Steps that reach an agent's best answer to the others within one update."""


def watched(rig, monkeypatch):
    """Return a list of (agents, advantages, their networks before the step), one entry a step."""
    steps, original = [], rig.learner.step_policies

    def step(batch, stacks):
        ((group,),) = (stack.groups for stack in stacks)
        nets = {g.id: copy.deepcopy(rig.learner.net(g.id)) for g in rig.spec.groups}
        steps.append((group, batch, nets))
        original(batch, stacks)

    monkeypatch.setattr(rig.learner, "step_policies", step)
    return steps


def probability(net, own):
    """Return how probable the actions (M, 1) are, from the network's linear layers written out."""
    first, _, last = net.body
    hidden = torch.tanh(own.observations[""] @ first.weight.T + first.bias)
    shares = torch.softmax(hidden @ last.weight.T + last.bias, -1)
    return shares.gather(-1, own.actions[..., None])[..., 0]


@pytest.mark.parametrize("game", [Cues, Ragged])
def test_each_agents_advantages_are_multiplied_by_the_ratios_of_all_that_stepped_before(game, monkeypatch):
    """M of section 4.2, written out; the ratio of an agent that is not there is 1."""
    rig = Rig("happo", game, lr=1e-2, epochs=3, minibatch_size=None)
    steps = watched(rig, monkeypatch)
    batch = rig.learner.prepare(rig.rollout(32))
    rig.learner.update_minibatch(batch)
    agents = len(rig.spec.agents)
    assert [group.id for group, *_ in steps[::3]] != []
    assert {group.id for group, *_ in steps} == set(rig.spec.agents)
    expected = batch.advantages.clone()
    with torch.no_grad():
        for k in range(agents):
            group, given, before = steps[3 * k]
            assert {g.id for g, *_ in steps[3 * k : 3 * k + 3]} == {group.id}, "all epochs of an agent first"
            torch.testing.assert_close(given.advantages, expected, rtol=1e-4, atol=1e-6)
            after = steps[3 * k + 3][2] if k + 1 < agents else {g: rig.learner.net(g) for g in before}
            own = batch.part(group)
            ratio = probability(after[group.id], own) / probability(before[group.id], own)
            expected = expected * torch.where(own.alive, ratio, 1.0)
    assert (expected - batch.advantages).abs().max() > 0.05, "the ratios must matter"


def test_the_order_is_drawn_in_every_update(monkeypatch):
    rig = Rig("happo", Ragged, epochs=1, minibatch_size=None)
    steps = watched(rig, monkeypatch)
    for _ in range(30):
        rig.learner.update_joint(rig.rollout(8))
    orders = {tuple(group.id for group, *_ in steps[k : k + 3]) for k in range(0, 90, 3)}
    assert len(orders) == 6


class Single(Cues):
    """`Cues` for one agent."""

    def __init__(self, config=None):
        super().__init__(config)
        self.possible_agents = self.agents = ["agent_0"]

    def reward(self, actions):
        return self.hit(actions)


def test_with_one_agent_it_is_ppo():
    """With one agent there is no earlier ratio; policy and critic step as PPO's with the same critic."""
    settings = {"lr": 1e-2, "epochs": 4, "minibatch_size": None}
    one, other = (Rig(name, Single, **settings) for name in ("happo", "centralised_v"))
    for _ in range(3):
        rollout = other.rollout(32)
        for rig in (one, other):
            rig.learner.update_joint(rollout)
    first, second = one.weights(), other.weights()
    for module, weights in first.items():
        for name, weight in weights.items():
            torch.testing.assert_close(weight, second[module][name], rtol=0, atol=1e-6)


def yielding_score(name, seed, updates=6):
    """Return how often greedy drivers are apart, less how often they collide, a step."""
    rig = Rig(name, Yielding, seed=seed, **STEEP)
    for _ in range(updates):
        rig.learner.update_joint(rig.rollout(64))
    return per_step(rig.greedy_episodes(5))


@pytest.mark.nightly
def test_drivers_that_improve_in_turn_yield():
    """1.0; 0 or -1 where both answer at once to what the other did."""
    assert (yielding_score("happo", 1) > 0.5).all()
