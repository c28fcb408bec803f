"""Encoders of sets: any order, empty places, gradients; and all algorithms that can read sets."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from gymnasium.spaces import Box, Dict, Discrete
from ray.rllib.env.multi_agent_env import MultiAgentEnv
from rigs import PLAYING, Rig, cases, known, takes

from algorithms.errors import SpaceError
from algorithms.joint.adapter import JointVector
from algorithms.joint.spec import JointSpec
from algorithms.parts.distributions import Exploration
from algorithms.parts.sets import SetEncoder
from tests.games.games import Cues

PLACES, FEATURES, WIDTH = 8, 5, 16
REPLAY = {"learning_starts": 1, "capacity": 1000, "batch_size": 32}


@pytest.fixture
def encoder():
    torch.manual_seed(0)
    return SetEncoder(PLACES, FEATURES, WIDTH).double()


def rows(present, count=6, seed=1):
    """Return `count` sets of so many random rows, the others zero."""
    generator = torch.Generator().manual_seed(seed)
    made = torch.randn(count, PLACES, FEATURES, generator=generator, dtype=torch.float64)
    made[:, present:] = 0.0
    return made


def test_the_vector_is_the_largest_and_the_summed_units_of_the_present_rows(encoder):
    given = rows(3)
    first, second = encoder.layers[0], encoder.layers[2]
    units = [
        torch.relu(second.weight @ torch.relu(first.weight @ row + first.bias) + second.bias)
        for row in given[0, :3]
    ]
    largest = torch.stack(units).max(0).values
    expected = torch.cat([largest, (units[0] + units[1] + units[2]) / PLACES])
    torch.testing.assert_close(encoder(given)[0], expected)
    assert not encoder(rows(0)).any()


def test_empty_places_get_no_gradient(encoder):
    given = rows(3).requires_grad_()
    (gradient,) = torch.autograd.grad(encoder(given).sum(), given)
    assert gradient[:, :3].any()
    assert not gradient[:, 3:].any()
    empty = rows(0).requires_grad_()
    parameters = [*encoder.parameters()]
    found = torch.autograd.grad(encoder(empty).sum(), [empty, *parameters])
    assert not any(each.any() for each in found)


SETS = cases([name for name in PLAYING if takes(name, set_width=8)])
"""Algorithms whose policies can read sets."""


class Signals(MultiAgentEnv):
    """Two agents; each is rewarded for action 1 if the larger number among the rows it sees is positive."""

    def __init__(self, config=None):
        super().__init__()
        self.possible_agents = self.agents = ["a", "b"]
        seen = Dict({"own": Box(-1.0, 1.0, (2,), np.float32), "rows": Box(-1.0, 1.0, (4, 3), np.float32)})
        self.observation_spaces = dict.fromkeys(self.agents, seen)
        self.action_spaces = {agent: Discrete(2) for agent in self.agents}

    def reset(self, *, seed=None, options=None):
        if seed is not None or not hasattr(self, "_draws"):
            self._draws = np.random.default_rng(seed)
        self._steps = 0
        return self._see(), {}

    def step(self, action_dict):
        rewards = {a: float(action_dict[a] == (self._rows[a][:, 0].max() > 0.0)) for a in action_dict}
        self._steps += 1
        ended = dict.fromkeys([*self.agents, "__all__"], self._steps >= 5)
        return self._see(), rewards, ended, dict.fromkeys(ended, False), {}

    def _see(self):
        self._rows = {a: self._draws.uniform(-1, 1, (4, 3)).astype(np.float32) for a in self.agents}
        return {a: {"own": np.zeros(2, np.float32), "rows": self._rows[a]} for a in self.agents}


def distributions(rig, view):
    """Return what actions are sampled from for moments (B,), shape (B, 2, 2)."""
    rig.policies.refresh()
    (sampled,) = rig.policies.act(view, Exploration(epsilon=0.3), torch.Generator().manual_seed(0))
    return sampled.distribution


@pytest.mark.parametrize("name", SETS)
def test_policies_of_all_algorithms_read_sets(name):
    """The order of rows does not change what policies do; learning changes the networks of sets."""
    rig = Rig(name, Signals, set_width=8, **known(name, REPLAY))
    before = rig.weights()
    rollout = rig.rollout(32, epsilon=1.0)
    rig.learner.update_joint(rollout)
    changed = rig.weights()
    of_sets = [(m, key) for m, weights in before.items() for key in weights if "sets.set_0" in key]
    assert {m for m, _ in of_sets} >= {group.id for group in rig.spec.groups}
    assert any(not torch.equal(before[m][key], changed[m][key]) for m, key in of_sets)

    # Weights with which outputs differ much from one observation to another.
    generator = torch.Generator().manual_seed(5 if name == "networked_q" else 1)
    with torch.no_grad():
        for group in rig.spec.groups:
            for parameter in rig.learner.net(group.id).parameters():
                parameter.copy_(torch.randn(parameter.shape, generator=generator))
    view = rollout.views[:32, 0]
    (leaves,) = view.observations
    turned = replace(view, observations=({**leaves, "rows": leaves["rows"][:, :, ::-1].copy()},))
    other = replace(view, observations=({**leaves, "rows": -leaves["rows"]},))
    given = distributions(rig, view)
    torch.testing.assert_close(distributions(rig, turned), given, rtol=0, atol=2e-5)
    assert (distributions(rig, other) - given).abs().max() > 4e-4


def test_sets_need_an_observation_that_has_some():
    spaces = JointVector(lambda _: Cues(), 1).spaces
    JointSpec.build(spaces)
    with pytest.raises(SpaceError, match="set_width=8"):
        JointSpec.build(spaces, set_width=8)


def test_joint_critics_read_each_agents_rows_in_any_order_and_none_of_the_absent():
    rig = Rig("maddpg", Signals, set_width=8, **REPLAY)
    rig.learner.replay.add(rig.rollout(32))
    batch = rig.learner.replay.sample(np.random.default_rng(0), 16)
    encoder = rig.learner.net("a__critic").q.encoder
    (leaves,), alive = batch.observations, batch.alive.clone()
    alive[:, 1] = False
    changed = leaves["rows"].clone()
    changed[:, 1] = -changed[:, 1]
    turned, other = ({**leaves, "rows": rows} for rows in (leaves["rows"].flip(2), changed))
    with torch.no_grad():
        given = encoder(batch)
        assert given.shape == (16, encoder.size) == (16, 2 * (2 + 2 * 8) + 2)
        torch.testing.assert_close(encoder(replace(batch, observations=(turned,))), given)
        assert not torch.equal(encoder(replace(batch, observations=(other,))), given)
        alone = encoder(replace(batch, alive=alive))
        assert torch.equal(encoder(replace(batch, observations=(other,), alive=alive)), alone)
