"""Random cooperative matrix games: one step, two agents with five actions, one payoff for the team.

There are 16 matrices, payoffs uniform in [0, 1]; the agents see which one they play. Rewards are scaled
matrix by matrix: the team's score is 1 for the best joint action of each, and 0 for uniformly random play.
"""

from __future__ import annotations

import numpy as np

from algorithms.joint.env import Bools, Floats, Ints
from perf.yardstick_games.vector import VectorGame

MATRICES, ACTIONS, SEED = 16, 5, 16


class Matrices(VectorGame):
    """B copies; each episode draws one of the matrices."""

    num_agents, num_actions, width, length = 2, ACTIONS, MATRICES, 1

    def __init__(self, num_envs: int) -> None:
        super().__init__(num_envs)
        self.payoffs = scaled(np.random.Generator(np.random.PCG64(SEED)).random((MATRICES, ACTIONS, ACTIONS)))
        self.number = np.zeros(num_envs, int)

    def begin(self, row: int, rng: np.random.Generator) -> None:
        """Draw the number of the matrix."""
        self.number[row] = rng.integers(MATRICES)

    def move(self, actions: Ints) -> tuple[Floats, Bools]:
        """Reward each agent with half of the payoff; the game ends."""
        payoffs = self.payoffs[self.number, actions[:, 0], actions[:, 1]]
        return np.repeat(payoffs[:, None] / 2, 2, 1), np.ones(self.num_envs, bool)

    def observe(self) -> Floats:
        """Return the number of the matrix, one-hot, to both agents."""
        return np.repeat(np.eye(MATRICES, dtype=np.float32)[self.number][:, None], 2, 1)


def scaled(payoffs: Floats) -> Floats:
    """Return matrices (K, A, A) with mean 0 and maximum 1 each."""
    mean = payoffs.mean((1, 2), keepdims=True)
    return (payoffs - mean) / (payoffs.max((1, 2), keepdims=True) - mean)
