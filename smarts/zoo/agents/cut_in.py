"""The agent `cut-in-v0`."""

from __future__ import annotations

import numpy as np

from smarts.agents.checks import check_number
from smarts.agents.policy import ActionBatch
from smarts.arrays import Floats, Ints
from smarts.observations.surroundings import OWN, Lane
from smarts.zoo.driving import LEAST_GAP, Driver, Memory, Seen, beside, may_change

REACH = 60.0
"""A vehicle farther ahead in the lane beside is no target [m]."""
LONGEST = 15.0
"""Largest gap in front of the target at which a change is a cut-in [m]."""


class CutIn(Driver):
    """Draws past a vehicle in a lane beside and changes closely in front of it, once; then drives by IDM.

    Args:
        gap: Least gap in front of the target [m].
        faster: By how much faster than the target it draws past [m/s].
        speed_factor: Highest speed, in speed limits.

    Raises:
        InterfaceError: An argument is not a number, or out of its range.
    """

    def __init__(self, gap: float = 4.0, faster: float = 4.0, speed_factor: float = 1.2) -> None:
        super().__init__(speed_factor=speed_factor)
        check_number("gap", gap, least=LEAST_GAP, most=LONGEST, place="CutIn")
        check_number("faster", faster, above=True, most=30.0, place="CutIn")
        self._gap, self._faster = float(gap), float(faster)
        self._done = Memory(1)

    def decide(self, batch: ActionBatch, seen: Seen) -> tuple[Floats, Ints]:
        """Return accelerations and lane changes; see `Driver`."""
        done = self._done.of(batch)
        is_open = done[:, 0] == 0.0
        side, pace = self._target(batch, seen)
        cuts = is_open & self._is_in_front(batch, seen, side)
        demanded = self.demanded_change(batch, seen)
        change = np.where(cuts, side, np.where(is_open, 0, demanded)).astype(np.int32)
        done[cuts] = 1.0
        self._done.keep(batch, done)
        found = self.follow(seen)
        # Not faster than needed to get past, never against what the leader allows.
        wanted = self.model.acceleration(seen.speed, pace, np.inf, 0.0)
        return np.where(is_open & np.isfinite(pace), np.minimum(found, wanted), found), change

    def _target(self, batch: ActionBatch, seen: Seen) -> tuple[Ints, Floats]:
        """Return the side of the vehicle to cut in on, 0 for none, and the speed to drive past it [m/s]."""
        best = np.zeros(len(seen.own), np.int32)
        pace, nearest = np.full(len(best), np.inf), np.full(len(best), np.inf)
        for side in (1, -1):
            sides = np.full(len(best), side, np.int32)
            lane = beside(seen, sides)
            is_behind = lane[:, Lane.BEHIND] < LONGEST
            distance = np.where(is_behind, 0.0, np.maximum(lane[:, Lane.AHEAD], 0.0))
            its_speed = np.where(is_behind, lane[:, Lane.BEHIND_SPEED], lane[:, Lane.AHEAD_SPEED])
            is_better = may_change(batch, seen, sides) & (distance < np.minimum(nearest, REACH))
            best[is_better], nearest[is_better] = side, distance[is_better]
            pace[is_better] = its_speed[is_better] + self._faster
        return best, pace

    def _is_in_front(self, batch: ActionBatch, seen: Seen, side: Ints) -> np.ndarray:
        """Return whether the change would be closely in front of the target, with room ahead."""
        lane = beside(seen, side)
        is_close = (lane[:, Lane.BEHIND] >= self._gap) & (lane[:, Lane.BEHIND] < LONGEST)
        closing = np.maximum(seen.speed - lane[:, Lane.AHEAD_SPEED], 0.0)
        has_room = lane[:, Lane.AHEAD] > self.model.min_gap + closing * self.model.tau
        is_past = seen.speed >= lane[:, Lane.BEHIND_SPEED]
        own_room = seen.lanes[:, OWN, Lane.AHEAD] > LEAST_GAP
        return may_change(batch, seen, side) & is_close & has_room & is_past & own_room
