"""A game with PettingZoo's parallel interface."""

from __future__ import annotations

import numpy as np
from gymnasium.spaces import Box, Discrete
from pettingzoo import ParallelEnv


class ZooCues(ParallelEnv):
    """The reward is 1 if the action equals the cue; "one" terminates at step 5, "two" is truncated at 10."""

    metadata = {"name": "cues"}  # noqa: RUF012 - PettingZoo's interface

    def __init__(self):
        self.possible_agents = ["one", "two"]

    def observation_space(self, agent):
        return Box(0.0, 1.0, (3,), np.float32)

    def action_space(self, agent):
        return Discrete(3)

    def reset(self, seed=None, options=None):
        self.rng = np.random.default_rng(seed)
        self.agents, self.t = list(self.possible_agents), 0
        return self._see(self.agents), {a: {} for a in self.agents}

    def step(self, actions):
        acting, self.t = self.agents, self.t + 1
        rewards = {a: float(actions[a] == self.cues[a]) for a in acting}
        ends = {a: a == "one" and self.t == 5 for a in acting}
        cuts = {a: self.t == 10 for a in acting}
        self.agents = [a for a in acting if not (ends[a] or cuts[a])]
        return self._see(acting), rewards, ends, cuts, {a: {} for a in acting}

    def _see(self, agents):
        self.cues = {a: int(self.rng.integers(3)) for a in agents}
        return {a: np.eye(3, dtype=np.float32)[c] for a, c in self.cues.items()}
