"""When frames are due: viewing is to cost a simulation little, however large it is."""

from __future__ import annotations

from dataclasses import dataclass

SHORTEST = 1 / 60
"""From one frame of a simulation to the next, at least [s]."""
LONGEST = 0.2
"""And at most, where steps are no longer [s]."""
SHARE = 0.025
"""The part of the time that frames may take."""
_WEIGHT = 0.1
"""Of the newest frame in the mean of their costs."""


@dataclass
class Pace:
    """Sets the time from one frame to the next: as long as their cost asks for, within bounds."""

    interval: float = SHORTEST
    """From one frame to the next [s]."""
    _due: float = 0.0
    _cost: float = SHARE * SHORTEST
    """What one frame takes, of all simulations together: a running mean [s]."""

    def is_due(self, now: float) -> bool:
        """Return whether the next frame is due at a time [s]."""
        return now >= self._due

    def count(self, now: float, cost: float) -> None:
        """Note that frames were sent at a time, and the processor time that they took [s]."""
        # At most double: the first frame of an episode takes longer than those that follow.
        self._cost += _WEIGHT * (min(cost, 2 * self._cost) - self._cost)
        self.interval = min(max(SHORTEST, self._cost / SHARE), LONGEST)
        self._due = now + self.interval
