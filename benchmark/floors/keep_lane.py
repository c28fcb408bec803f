"""Drives on, whoever is in the way."""

import numpy as np
from numpy.typing import NDArray

from smarts.types.actions import LaneAction
from smarts.types.episode import EpisodeStart


class KeepLane:
    """Keeps its lane at the speed limit."""

    def begin(self, episode: EpisodeStart, agent: int) -> None:
        """Remember nothing."""

    def act(self, observation: NDArray[np.float32], mask: NDArray[np.bool_]) -> int:
        """Return keep_lane."""
        return LaneAction.keep_lane
