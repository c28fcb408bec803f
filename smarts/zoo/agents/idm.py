"""The agent `idm-v0`."""

from __future__ import annotations

from smarts.agents.policy import ActionBatch
from smarts.arrays import Floats, Ints
from smarts.zoo.driving import Driver, Seen


class IdmDriver(Driver):
    """Follows its route by the intelligent driver model; changes lanes only where the route demands it."""

    def decide(self, batch: ActionBatch, seen: Seen) -> tuple[Floats, Ints]:
        """Return accelerations and lane changes; see `Driver`."""
        return self.follow(seen), self.demanded_change(batch, seen)
