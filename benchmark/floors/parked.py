"""Does not drive."""

import numpy as np
from numpy.typing import NDArray

from smarts.types.actions import LaneAction
from smarts.types.episode import EpisodeStart


class Parked:
    """Brakes until it stands, and stays there."""

    def begin(self, episode: EpisodeStart, agent: int) -> None:
        """Remember nothing."""

    def act(self, observation: NDArray[np.float32], mask: NDArray[np.bool_]) -> int:
        """Return slow_down."""
        return LaneAction.slow_down
