"""The agent `overtaking-v0`."""

from __future__ import annotations

import numpy as np

from smarts.agents.policy import ActionBatch
from smarts.arrays import Bools, Floats, Ints
from smarts.observations.surroundings import OWN, Lane, Own
from smarts.zoo.driving import HORIZON_TIME, Memory, Seen, beside
from smarts.zoo.planned import PlannedDriver

NEAR = 50.0
"""A slower leader nearer than this is overtaken [m]."""
BACK_GAP = 8.0
"""It goes back to its lane this far ahead of the vehicle that it has overtaken [m], or farther..."""
BACK_TIME = 1.0
"""...by this time at its speed [s]."""


class Overtaking(PlannedDriver):
    """Overtakes slower leaders in the lane to the left, else the right, and goes back to its lane.

    Args:
        slower: By how much slower than its desired speed a leader has to be [m/s].
        speed_factor: Desired speed, in speed limits.
        planner: Planner of its lane changes: a name such as "receding_horizon", or a "module:Class".

    Raises:
        SmartsError: There is no such planner.
    """

    def __init__(
        self, slower: float = 2.0, speed_factor: float = 1.1, planner: str = "receding_horizon"
    ) -> None:
        super().__init__(planner, speed_factor=speed_factor)
        self._slower = float(slower)
        self._way_back = Memory(1)

    def decide(self, batch: ActionBatch, seen: Seen) -> tuple[Floats, Ints]:
        """Return accelerations and lane changes; see `Driver`."""
        way_back = self._way_back.of(batch)[:, 0].astype(np.int32)
        out = np.where(way_back == 0, self._way_out(batch, seen), 0)
        back = np.where(self._has_passed(batch, seen, way_back), way_back, 0)
        demanded = self.demanded_change(batch, seen)
        change = np.where(demanded != 0, demanded, np.where(out != 0, out, back)).astype(np.int32)
        return self.follow(seen), change

    def begun(self, batch: ActionBatch, seen: Seen, change: Ints) -> None:
        """Keep the way back; a change that the route demands ends the manoeuvre."""
        memory = self._way_back.of(batch)
        goes_out = (memory[:, 0] == 0.0) & (seen.own[:, Own.DEMANDED] == 0.0)
        memory[:, 0] = np.where(change == 0, memory[:, 0], np.where(goes_out, -change, 0))
        self._way_back.keep(batch, memory)

    def given_up(self, batch: ActionBatch, is_late: Bools) -> None:
        """Forget the way back, so that the driver may try again."""
        memory = self._way_back.of(batch)
        memory[is_late] = 0.0
        self._way_back.keep(batch, memory)

    def _way_out(self, batch: ActionBatch, seen: Seen) -> Ints:
        """Return the side on which to overtake the leader, 0 for not at all, shape (N,)."""
        leader, desired = seen.lanes[:, OWN], self.desired(seen)
        is_slow = (leader[:, Lane.AHEAD] < NEAR) & (leader[:, Lane.AHEAD_SPEED] < desired - self._slower)
        side = np.zeros(len(desired), np.int32)
        for each in (-1, 1):
            sides = np.full(len(side), each, np.int32)
            lane = beside(seen, sides)
            is_faster = (lane[:, Lane.AHEAD_SPEED] > leader[:, Lane.AHEAD_SPEED] + self._slower) | (
                lane[:, Lane.AHEAD] > leader[:, Lane.AHEAD] + NEAR
            )
            goes_on = lane[:, Lane.LEFT] > HORIZON_TIME * seen.speed
            side[is_slow & is_faster & goes_on & self.is_safe(batch, seen, sides)] = each
        return np.where(seen.own[:, Own.DEMANDED] == 0.0, side, 0)

    def _has_passed(self, batch: ActionBatch, seen: Seen, side: Ints) -> Bools:
        """Return whether the lane to go back to is free, ahead too, shape (N,)."""
        lane = beside(seen, side)
        room = np.maximum(BACK_GAP, BACK_TIME * seen.speed)
        is_free = (lane[:, Lane.BEHIND] > room) & (lane[:, Lane.AHEAD] > 2.0 * room)
        return is_free & self.is_safe(batch, seen, side)
