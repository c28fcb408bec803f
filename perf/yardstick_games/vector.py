"""What the games have in common: B copies, seeds, and resets as soon as an episode ends."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete

from algorithms.joint.env import (
    AgentBlock,
    Bools,
    FinalStep,
    Floats,
    Ints,
    JointSpaces,
    JointStep,
    episode_seed,
)


class VectorGame:
    """B copies of a game of N equal agents, which all act until the episode ends for all of them.

    A subclass sets the attributes below and has `begin`, `move` and `observe`; its arrays have B rows.

    Args:
        num_envs: Number of copies B.
    """

    num_agents: int
    num_actions: int
    width: int
    """Numbers in an agent's observation."""
    length: int
    """Steps after which an episode is over."""
    limit_ends = False
    """Whether this limit is a termination, beyond which nothing is bootstrapped."""

    def __init__(self, num_envs: int) -> None:
        self.num_envs = num_envs
        names = tuple(f"agent_{i}" for i in range(self.num_agents))
        seen = Box(-np.inf, np.inf, (self.width,), np.float32)
        self.spaces = JointSpaces((AgentBlock(names, {"": seen}, Discrete(self.num_actions)),))
        self._seed = self._stride = 0
        self._indices, self._episodes = np.zeros(num_envs, int), np.zeros(num_envs, int)
        self._time = np.zeros(num_envs, int)

    def begin(self, row: int, rng: np.random.Generator) -> None:
        """Start an episode in one copy."""
        raise NotImplementedError

    def move(self, actions: Ints) -> tuple[Floats, Bools]:
        """Act in all copies, (B, N); return rewards (B, N) and which games have come to their end, (B,)."""
        raise NotImplementedError

    def observe(self) -> Floats:
        """Return a new array of what the agents see, (B, N, width), float32."""
        raise NotImplementedError

    def reset(self, seed: int, indices: Ints, *, stride: int = 0) -> JointStep:
        """Start all copies; see `VectorJointEnv.reset`."""
        self._seed, self._stride = seed, stride
        self._indices, self._episodes = np.array(indices, int), np.zeros(self.num_envs, int)
        for row in range(self.num_envs):
            self._begin(row)
        none = np.zeros((self.num_envs, self.num_agents), bool)
        return JointStep(
            ({"": self.observe()},),
            np.zeros(none.shape, np.float32),
            none,
            none,
            ~none,
            none[:, 0],
            masks=(None,),
        )

    def step(self, actions: tuple[np.ndarray, ...]) -> JointStep:
        """Act in all copies, and restart those whose episode ended."""
        rewards, ended = self.move(actions[0])
        self._time += 1
        over = ended | (self._time >= self.length)
        seen, rows = self.observe(), np.flatnonzero(over)
        final = None
        if len(rows):
            final = FinalStep(rows, ({"": seen[rows]},), (None,))
            self._indices[rows] += self._stride
            self._episodes[rows] += self._stride == 0
            for row in rows.tolist():
                self._begin(row)
            seen[rows] = self.observe()[rows]
        shape = (self.num_envs, self.num_agents)
        terminal = over if self.limit_ends else ended
        terminated = np.broadcast_to(terminal[:, None], shape)
        truncated = np.broadcast_to((over & ~terminal)[:, None], shape)
        alive = np.ones(shape, bool)
        return JointStep(
            ({"": seen},), rewards.astype(np.float32), terminated, truncated, alive, over, final, (None,)
        )

    def recreate(self, failures: Any) -> JointStep:
        """Raise: no step of these games fails.

        Raises:
            RuntimeError: Always.
        """
        raise RuntimeError(f"copies {sorted(failures)} of {type(self).__name__} failed")

    @property
    def worlds(self) -> Ints:
        """Index of the episode that each copy plays, (B,)."""
        return self._indices

    def close(self) -> None:
        """Do nothing: there is nothing to release."""

    def get_state(self) -> dict[str, Any]:
        """Return what a continued run needs."""
        return copy.deepcopy(self.__dict__)

    def set_state(self, state: dict[str, Any]) -> None:
        """Continue where `get_state` was called."""
        self.__dict__.update(copy.deepcopy(state))

    def _begin(self, row: int) -> None:
        seed = episode_seed(self._seed, int(self._indices[row]), int(self._episodes[row]))
        self._time[row] = 0
        # As Gymnasium seeds its environments, so that an episode of the package has the same draws.
        self.begin(row, np.random.Generator(np.random.PCG64(seed)))
