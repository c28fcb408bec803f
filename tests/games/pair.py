"""An algorithm for two agents that sample joint actions with a latent per episode, and its environment."""

import numpy as np
import torch
from gymnasium.spaces import Box

from algorithms.joint.algorithm import JointAlgorithm
from algorithms.joint.config import JointConfig
from algorithms.joint.env import LATENT, FinalStep, JointStep
from algorithms.joint.learner import JointTorchLearner
from algorithms.joint.module import JointModule
from algorithms.parts.distributions import SampledActions
from algorithms.registry import ALGORITHMS
from tests.games.null import NullVector

WIDTH = 6
TABLE = torch.tensor([[0.5, 0.1], [0.1, 0.3]])
"""Joint probabilities of the two agents' actions, which are correlated."""


class PairModule(JointModule):
    """Samples the first agent's action, then the second's given the first's; both get the same latent."""

    acts_jointly = True

    def make_networks(self):
        self.logits = torch.nn.Parameter(TABLE.log())

    def policy(self, view):
        raise AssertionError("agents are never sampled alone")

    @classmethod
    def begin_episode(cls, modules, views, generator):
        latent = torch.randn(1, 1, WIDTH, generator=generator)
        return [latent.expand(*view.alive.shape, WIDTH) for view in views]

    def conditionals(self):
        """Return log p(a_1), shape (2,), and log p(a_2 | a_1), shape (2, 2)."""
        joint = self.logits.flatten().log_softmax(0).view(2, 2)
        first = joint.logsumexp(1)
        return first, joint - first[:, None]

    @classmethod
    def act_jointly(cls, modules, views, exploration, generator):
        first, second = modules[0].conditionals()
        count = len(views[0].alive)
        leads = torch.multinomial(first.exp(), count, replacement=True, generator=generator)
        follows = torch.multinomial(second.exp()[leads], 1, generator=generator)[:, 0]
        if not exploration.explore:
            leads = torch.full((count,), int(first.argmax()))
            follows = second[leads].argmax(-1)
        acting = SampledActions(
            torch.stack([leads, follows], 1),
            torch.stack([first[leads], second[leads, follows]], 1),
            torch.stack([first.exp().expand(count, 2), second.exp()[leads]], 1),
        )
        return [acting] if len(modules) == 1 else [part(acting, column) for column in range(2)]


def part(acting, column):
    """Return the sampled action of one agent."""
    return SampledActions(*(x[:, column : column + 1] for x in acting[:3]))


class PairConfig(JointConfig):
    algorithm = "pair"
    entry = ALGORITHMS["ppo"]
    policy_module = PairModule

    def carried(self, block):
        return {LATENT: Box(-np.inf, np.inf, (WIDTH,), np.float32)}


class Pair(JointAlgorithm):
    config_class = PairConfig
    learner_class = JointTorchLearner


class Vector(NullVector):
    """Random observations with saved state, in environments whose episodes take 3, 4, 5, ... steps."""

    def __init__(self, config):
        super().__init__()
        self.num_envs = config["num_envs"]

    def get_state(self):
        return {"t": self.t, "rng": self.rng}

    def set_state(self, state):
        self.t, self.rng = state["t"], state["rng"]

    def _now(self, over=False):
        shape = (self.num_envs, 2)
        ends = (self.t > 0) & (self.t % (3 + np.arange(self.num_envs)) == 0)
        seen = self.rng.uniform(-1, 1, (*shape, 3)).astype(np.float32)
        last = FinalStep(np.flatnonzero(ends), ({"": seen[ends]},), (None,))
        alive, none = np.ones(shape, bool), np.zeros(shape, bool)
        cut = none | ends[:, None]
        return JointStep(({"": seen},), np.ones(shape, np.float32), none, cut, alive, ends, last)
