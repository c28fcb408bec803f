"""What a scripted policy is."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from smarts.types.episode import EpisodeStart


class Floor(Protocol):
    """Acts for one agent in one episode. Its class is called without arguments, once for each agent."""

    def begin(self, episode: EpisodeStart, agent: int) -> None:
        """Begin an episode; draws, if any, are a function of the episode and the agent's number."""
        ...

    def act(self, observation: NDArray[np.float32], mask: NDArray[np.bool_]) -> int:
        """Return an action of the environment's action space: with lane actions a legal one, 0 to 3.

        Args:
            observation: Of the agent, as its adapter gives it: the benchmark's vector; a dict of arrays by
                name where the adapter has several.
            mask: Which lane actions are legal, shape (4,); all, where agents act otherwise.
        """
        ...
