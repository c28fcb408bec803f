"""Learners, policies and data without Ray."""

from typing import Any

import numpy as np
import pytest
import torch

import algorithms
from algorithms.joint.adapter import JointVector
from algorithms.joint.env import is_vector_env
from algorithms.joint.policies import Policies
from algorithms.joint.runner import SPEC
from algorithms.joint.sampler import Sampler
from algorithms.parts.distributions import Exploration
from algorithms.setting_kinds import faults
from algorithms.settings import ReplaySettings

FAMILIES = {"ppo", "dqn", "maddpg", "qmix", "commnet", "networked_q"}
"""One algorithm of each family."""


def cases(names):
    """Return names as cases of a test: one algorithm of each family in `make test`, the others nightly."""
    return [name if name in FAMILIES else pytest.param(name, marks=pytest.mark.nightly) for name in names]


def first(*values):
    """Return values as cases of a test: the first in `make test`, the others nightly."""
    several = (value if isinstance(value, tuple) else (value,) for value in values[1:])
    return [values[0], *(pytest.param(*value, marks=pytest.mark.nightly) for value in several)]


PLAYING = [name for name in algorithms.names() if name != "bc"]
"""Algorithms that learn from what agents do, and not from demonstrations."""
EVERY = cases(PLAYING)
OFF_POLICY = [name for name in PLAYING if issubclass(algorithms.entry(name).settings, ReplaySettings)]


def takes(name, **settings):
    """Return whether an algorithm can be set so."""
    return not faults(algorithms.entry(name).settings, settings)


SHARED = cases([name for name in PLAYING if takes(name, sharing="all")])
"""Algorithms whose agents may share a network."""


def known(name, settings):
    """Return those of some settings that an algorithm has."""
    fields = algorithms.entry(name).settings.model_fields
    return {setting: value for setting, value in settings.items() if setting in fields}


class Rig:
    """A learner and a sampler with its policies, on two copies of a game, or on a vector environment."""

    def __init__(self, name, game, env_config=None, seed=0, learners=0, gpus=0, **settings):
        env = game if is_vector_env(game) else JointVector(lambda b: game(env_config or {}), 2)
        settings = {"hidden": (16,), **settings}
        self.config = algorithms.config(name).debugging(seed=seed).training(**settings)
        self.config.learners(num_learners=learners, num_gpus_per_learner=gpus)
        self.env = self.config.adapt(env)
        self.spec = self.config.spec_of(self.env)
        modules = self.config.get_multi_rl_module_spec(spaces={SPEC: (self.spec, None)})
        torch.manual_seed(seed)
        learner: Any = self.config.get_default_learner_class()
        self.learner: Any = learner(config=self.config, module_spec=modules)
        self.learner.build()
        nets = {g.id: self.learner.net(g.id) for g in self.spec.groups}
        self.policies = Policies(self.spec, nets)
        self.sampler = Sampler(self.env, self.policies, self.spec, seed=seed, max_failures=1000)

    def rollout(self, steps=32, **exploration):
        self.policies.refresh()
        return self.sampler.fragment(steps, Exploration(**exploration))

    def learn(self, steps, length=8, explore=None):
        """Learn from so many environment steps, exploring as the settings or `explore(steps done)` say."""
        done = 0
        while done < steps:
            how = explore(done) if explore else self.config.exploration(done)._asdict()
            rollout = self.rollout(length, **how)
            self.learner.update_joint(rollout)
            done += rollout.env_steps()

    def greedy_episodes(self, count):
        """Play the first episodes of the fixed evaluation list."""
        self.policies.refresh()
        return self.sampler.episodes(1_000_000 + np.arange(count), Exploration(explore=False))

    def weights(self):
        return {
            module: {k: v.detach().clone() for k, v in self.learner.net(module).state_dict().items()}
            for module in self.learner.module.keys()  # noqa: SIM118 - RLlib's module is no dict
        }


def per_step(episodes):
    """Return what each agent earns a step of episodes, (N,)."""
    return np.sum([e.returns for e in episodes], 0) / sum(e.length for e in episodes)


def moved(before, after):
    """Return the modules whose weights differ."""
    return {m for m in before if any(not torch.equal(before[m][k], after[m][k]) for k in before[m])}


def replayed(rig, steps=32, count=64, **exploration):
    """Return a minibatch of fresh experience."""
    rig.learner.replay.add(rig.rollout(steps, **exploration))
    return rig.learner.replay.sample(np.random.default_rng(0), count)


def train(algo, iterations):
    """Return the last result."""
    result: dict[str, Any] = {}
    for _ in range(iterations):
        result = algo.train()
    return result


def weights_of(algo):
    """Return an algorithm's weights by network and name."""
    state = algo.learner_group.get_state()["learner"]["rl_module"]
    return {f"{module}/{name}": np.array(x) for module, part in state.items() for name, x in part.items()}
