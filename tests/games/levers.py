"""G5: CommNet's lever game, as a vector environment."""

from __future__ import annotations

import numpy as np
from gymnasium.spaces import Box, Discrete

from algorithms.joint.env import AgentBlock, JointSpaces, JointStep


class Levers:
    """5 of a pool of 20 agents each pull one of 5 levers; the reward of all is the share of pulled levers.

    An agent observes only its number in the pool, drawn in every step, so it does not know the other agents.
    Uniform play scores 1 - 0.8^5 = 0.672, agents that communicate 1.0, agents without communication at most
    0.718. The game never ends; use gamma 0.
    """

    pool, levers = 20, 5

    def __init__(self, num_envs: int):
        self.num_envs = num_envs
        agents = tuple(f"agent_{i}" for i in range(self.levers))
        seen = {"": Box(0.0, 1.0, (self.pool,), np.float32)}
        self.spaces = JointSpaces((AgentBlock(agents, seen, Discrete(self.levers)),))

    def reset(self, seed, worlds, *, episode=0, stride=0):
        self.rng = np.random.default_rng([seed, *worlds])
        return self._joint_step(np.zeros((self.num_envs, self.levers), np.float32))

    def step(self, actions):
        pulled = np.eye(self.levers, dtype=bool)[actions[0]].any(1)
        share = pulled.mean(1, keepdims=True, dtype=np.float32)
        return self._joint_step(np.repeat(share, self.levers, 1))

    def recreate(self, failures):
        raise RuntimeError("levers do not break") from next(iter(failures.values()))

    def close(self):
        pass

    def _joint_step(self, rewards):
        drawn = self.rng.random((self.num_envs, self.pool)).argsort(1)[:, : self.levers]
        never = np.zeros((self.num_envs, self.levers), bool)
        seen = {"": np.eye(self.pool, dtype=np.float32)[drawn]}
        return JointStep((seen,), rewards, never, never, ~never, never[:, 0])
