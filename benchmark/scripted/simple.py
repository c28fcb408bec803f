"""Policies that ignore the observation: keep the lane, park, act at random."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from smarts.types.actions import LaneAction
from smarts.types.episode import EpisodeStart
from smarts.types.streams import Purpose, stream


class KeepLane:
    """Keeps the lane at the speed limit and does not brake for other vehicles."""

    def begin(self, episode: EpisodeStart, agent: int) -> None:
        """Do nothing."""

    def act(self, observation: NDArray[np.float32], mask: NDArray[np.bool_]) -> int:
        """Return keep_lane."""
        return LaneAction.keep_lane


class Parked:
    """Brakes to standstill and stays there."""

    def begin(self, episode: EpisodeStart, agent: int) -> None:
        """Do nothing."""

    def act(self, observation: NDArray[np.float32], mask: NDArray[np.bool_]) -> int:
        """Return slow_down."""
        return LaneAction.slow_down


class RandomActions:
    """Draws each action uniformly from the allowed ones."""

    def begin(self, episode: EpisodeStart, agent: int) -> None:
        """Seed the agent's random stream."""
        draws = stream(episode.seed, Purpose.AGENTS, world=episode.world, episode=episode.episode)
        self._draws = stream(int(draws.integers(2**31, size=agent + 1)[agent]), Purpose.AGENTS)

    def act(self, observation: NDArray[np.float32], mask: NDArray[np.bool_]) -> int:
        """Return an allowed action."""
        return int(self._draws.choice(np.flatnonzero(mask)))
