"""The gap-acceptance policy: shows that a scenario can be solved with the agents' observation and actions."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from smarts.types.episode import EpisodeStart
from smarts.zoo.agents.gap_acceptance import choose


class GapAcceptancePolicy:
    """Decides as the agent `gap-acceptance-v0` of the zoo."""

    observation: ClassVar[str] = "benchmark"

    def begin(self, episode: EpisodeStart, agent: int) -> None:
        """Forget the last episode."""
        self._waited = 0

    def act(self, observation: NDArray[np.float32], mask: NDArray[np.bool_]) -> int:
        """Return an allowed action."""
        action, self._waited = choose(observation, mask, self._waited)
        return action
