"""How far the episodes of a sampler are, and what is known of those that ended."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from algorithms.joint.env import Bools, Floats, Ints, JointStep


class Episode(NamedTuple):
    """An episode that ended.

    Attributes:
        env_id: The environment that played it.
        length: Steps.
        returns: Undiscounted sum of rewards of each agent, (N,).
        metrics: Numbers that the environment reported.
        episode_index: Index among the episodes that the root seed makes.
    """

    env_id: int
    length: int
    returns: Floats
    metrics: Mapping[str, float]
    episode_index: int = -1

    def env_steps(self) -> int:
        """Return the number of steps (RLlib asks for it)."""
        return self.length

    def agent_steps(self) -> int:
        """Return the number of agent-steps (RLlib asks for it), as if all agents had acted throughout."""
        return self.length * len(self.returns)


@dataclass
class EpisodeProgress:
    """The place of each environment in its present episode.

    Attributes:
        returns: Sum of rewards so far, (B, N).
        episode_index: Index of the present episode, (B,).
        lengths: Steps so far, (B,).
        steps: Steps since the sampler began, (B,).
        number: Place of the present episode among those of its index, (B,); 0 with a stride.
        failures: Failures since the last completed episode, (B,).
        stride: Difference of the indices of an environment's successive episodes; 0: all have one index.
        failed_total: All failures so far.
        ended: Episodes completed since they were last taken.
    """

    returns: Floats
    episode_index: Ints
    lengths: Ints
    steps: Ints
    number: Ints
    failures: Ints
    stride: int = 0
    failed_total: int = 0
    ended: list[Episode] = field(default_factory=list)

    @classmethod
    def begin(cls, indices: Ints, agents: int, stride: int = 0, failed_total: int = 0) -> EpisodeProgress:
        """Return the progress of environments whose first episodes have these indices, (B,)."""
        lengths, steps, number, failures = (np.zeros(len(indices), int) for _ in range(4))
        returns = np.zeros((len(indices), agents))
        return cls(returns, indices, lengths, steps, number, failures, stride, failed_total)

    def account(self, step: JointStep, acted: Bools) -> Bools:
        """Account for a step of all environments; return those that begin a new episode, (B,).

        Args:
            step: What happened.
            acted: Agents that acted in it, (B, N).
        """
        self.returns += step.rewards * acted
        self.lengths += 1
        self.steps += 1
        over = step.reset.copy()
        over[list(step.failed)] = True
        if not over.any():
            return over
        whole = over.copy()
        whole[list(step.failed)] = False
        for b in np.flatnonzero(whole).tolist():
            metrics, returns = step.metrics.get(b, {}), self.returns[b].copy()
            self.ended.append(Episode(b, int(self.lengths[b]), returns, metrics, int(self.episode_index[b])))
        self.failures[whole] = 0
        self.failures[list(step.failed)] += 1
        self.failed_total += len(step.failed)
        self.returns[over] = self.lengths[over] = 0
        if self.stride:
            self.episode_index[whole] += self.stride  # an episode that failed is played again
        else:
            self.number[over] += 1
        return over

    def take(self) -> list[Episode]:
        """Return the episodes that ended since the last call."""
        ended, self.ended = self.ended, []
        return ended
