"""The gap-acceptance policy: shows that a scenario can be solved with the agents' observation and actions."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from smarts.observations.scales import SPEED_SCALE
from smarts.types.actions import LaneAction
from smarts.types.episode import EpisodeStart
from smarts.zoo.agents.gap_acceptance import choose, layout_of

CREEPING = 3.0
"""[m/s]"""


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


class EmptyRoad(GapAcceptancePolicy):
    """Decides as `GapAcceptancePolicy` would if there were no other vehicles."""

    def act(self, observation: NDArray[np.float32], mask: NDArray[np.bool_]) -> int:
        """Return an allowed action."""
        alone = observation.copy()
        alone[layout_of(observation)["neighbors"]] = 0.0
        return super().act(alone, mask)


class Creep(GapAcceptancePolicy):
    """Decides as `GapAcceptancePolicy`, but creeps, and lets all others go first at junctions."""

    def act(self, observation: NDArray[np.float32], mask: NDArray[np.bool_]) -> int:
        """Return an allowed action."""
        layout = layout_of(observation)
        last = observation.copy()
        arrival = last[layout["arrival_order"]]
        last[layout["arrival_order"]] = np.where(arrival >= 0.0, 1.0, arrival)
        self._waited = 0  # it never claims the right of way
        action = super().act(last, mask)
        is_fast = observation[layout["speed"]][0] * SPEED_SCALE > CREEPING
        return LaneAction.slow_down if is_fast and action == LaneAction.keep_lane else action
