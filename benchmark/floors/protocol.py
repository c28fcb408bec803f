"""What a floor policy is."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from smarts.types.episode import EpisodeStart


class Floor(Protocol):
    """Acts for one agent in one episode."""

    def begin(self, episode: EpisodeStart, agent: int) -> None:
        """Begin an episode; draws, if any, are a function of the episode and the agent's number."""
        ...

    def act(self, observation: NDArray[np.float32], mask: NDArray[np.bool_]) -> int:
        """Return a legal action, 0 to 3."""
        ...
