"""Prioritised replay: transitions of larger error are drawn more often, and weigh less in exchange."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from algorithms.joint.batch import ReplayBatch
from algorithms.joint.env import Ints
from algorithms.joint.replay import JointReplay
from algorithms.joint.rollout import JointRollout
from algorithms.joint.spec import JointSpec

SMALLEST = 1e-6


class PrioritisedReplay(JointReplay):
    """Proportional prioritisation: Schaul et al. 2016, "Prioritized Experience Replay", section 3.3-3.4.

    Transition i is drawn with P(i) = p_i^alpha / sum_k p_k^alpha and weighs (N P(i))^-beta, divided by the
    largest weight of all that are stored. New transitions get the largest priority so far. The cumulative sum
    is rebuilt at every draw, which numpy does faster than Python walks a sum tree.

    Args:
        spec: Agents and spaces.
        capacity: Joint transitions kept.
        alpha: 0 is uniform, 1 fully proportional.
        beta: How far weights undo the bias: 1 entirely.
    """

    def __init__(self, spec: JointSpec, capacity: int, *, alpha: float, beta: float) -> None:
        super().__init__(spec, capacity)
        self._alpha, self._beta = alpha, beta
        self._scaled = np.zeros(self.capacity)
        self._largest = 1.0

    def add(self, rollout: JointRollout) -> Ints:
        """Store the transitions of a rollout with the largest priority so far; return their places."""
        rows = super().add(rollout)
        self._scaled[rows] = self._largest**self._alpha
        return rows

    def sample(self, rng: np.random.Generator, count: int, device: torch.device | str = "cpu") -> ReplayBatch:
        """Return `count` transitions drawn by priority with replacement, with their weights."""
        cumulative = np.cumsum(self._scaled[: len(self)])
        # A product can round up to the last sum itself.
        drawn = np.searchsorted(cumulative, rng.random(count) * cumulative[-1], side="right")
        rows = np.minimum(drawn, len(self) - 1)
        scaled = self._scaled[: len(self)]
        weights = (scaled[rows] / scaled.min()) ** -self._beta
        return self.batch(rows, device, weights=torch.from_numpy(weights.astype(np.float32)).to(device))

    def reprioritise(self, rows: Tensor, surprise: Tensor) -> None:
        """Set the priorities of the transitions at these places.

        Args:
            rows: Places, (M,).
            surprise: Absolute temporal differences, (M,).
        """
        priorities = surprise.detach().double().cpu().numpy() + SMALLEST
        self._scaled[rows.cpu().numpy()] = priorities**self._alpha
        self._largest = max(self._largest, float(priorities.max()))

    def get_state(self) -> dict[str, Any]:
        """Return a copy of the stored transitions and their priorities."""
        own = {"scaled": self._scaled[: len(self)].copy(), "largest": self._largest}
        return {**super().get_state(), **own}

    def set_state(self, state: dict[str, Any]) -> None:
        """Restore what `get_state` gave; see `JointReplay.set_state`."""
        super().set_state(state)
        self._scaled[: len(self)] = state["scaled"][self._restored(state)]
        self._largest = state["largest"]
