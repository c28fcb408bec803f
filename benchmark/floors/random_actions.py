"""Does anything."""

import numpy as np
from numpy.typing import NDArray

from smarts.types.episode import EpisodeStart
from smarts.types.streams import Purpose, stream


class RandomActions:
    """Draws each action from those that are legal."""

    def begin(self, episode: EpisodeStart, agent: int) -> None:
        """Begin the agent's stream of draws."""
        draws = stream(episode.seed, Purpose.AGENTS, world=episode.world, episode=episode.episode)
        self._draws = stream(int(draws.integers(2**31, size=agent + 1)[agent]), Purpose.AGENTS)

    def act(self, observation: NDArray[np.float32], mask: NDArray[np.bool_]) -> int:
        """Return a legal action."""
        return int(self._draws.choice(np.flatnonzero(mask)))
