"""A vector environment with random observations and the argument checks of the benchmark's environment."""

import numpy as np
from gymnasium.spaces import Box, Discrete

from algorithms.joint.env import AgentBlock, FinalStep, JointSpaces, JointStep
from smarts.types.streams import check_seed

LENGTH = 20
"""Steps of an episode; longer than a rollout fragment, so that trajectories are open at interruptions."""


class NullVector:
    """Two environments that take the benchmark environment's arguments and provide no saved state either."""

    num_envs = 2
    spaces = JointSpaces((AgentBlock(("a", "b"), {"": Box(-1.0, 1.0, (3,), np.float32)}, Discrete(2)),))

    def __init__(self, config=None):
        self.begun = []
        """Seed and worlds of each reset."""
        self.t = 0

    def reset(self, seed, worlds, *, episode=0, stride=0):
        check_seed(seed, "reset")
        self.begun.append((seed, *np.asarray(worlds).tolist(), episode))
        self.rng, self.t = np.random.default_rng([seed, episode]), 0
        return self._now()

    def step(self, actions):
        self.t += 1
        return self._now(over=self.t % LENGTH == 0)

    def recreate(self, failures):
        raise RuntimeError("nothing breaks here")

    def close(self):
        pass

    def _now(self, over=False):
        seen = ({"": self.rng.uniform(-1, 1, (2, 2, 3)).astype(np.float32)},)
        none, cut = np.zeros((2, 2), bool), np.full((2, 2), over)
        final = FinalStep(np.arange(2), seen, (None,)) if over else None
        return JointStep(seen, np.ones((2, 2), np.float32), none, cut, ~none, cut[:, 0], final)
