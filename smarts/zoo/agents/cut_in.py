"""The agent `cut-in-v0`."""

from __future__ import annotations

import numpy as np

from smarts.agents.policy import ActionBatch
from smarts.arrays import Bools, Floats, Ints
from smarts.observations.surroundings import OWN, Lane
from smarts.zoo.driving import LEAST_GAP, Memory, Seen, beside, may_change
from smarts.zoo.planned import Goal, PlannedDriver

REACH = 60.0
"""A vehicle farther ahead in the lane beside is no target [m]."""
LONGEST = 15.0
"""Largest gap in front of the target at which a change is a cut-in [m]."""
SOONEST, LATEST = 3.0, 5.0
"""Time from the beginning of the change to the pose in front of the target, at least and at most [s]."""
SLOWER = 1.0
"""Speed by which the vehicle may be slower than the target when the change begins [m/s]."""
SPARE = 1.0
"""Added to the least gap, for the target's accelerating meanwhile [m]."""


class CutIn(PlannedDriver):
    """Draws past a vehicle in a lane beside and changes closely in front of it, once; then drives by IDM.

    Args:
        gap: In front of the target at the end of the change, at least [m].
        faster: By how much faster than the target it draws past [m/s].
        speed_factor: Highest speed, in speed limits.
        planner: Planner of its lane changes: a name such as "receding_horizon", or a "module:Class".

    Raises:
        SmartsError: There is no such planner.
    """

    def __init__(
        self,
        gap: float = 4.0,
        faster: float = 4.0,
        speed_factor: float = 1.2,
        planner: str = "receding_horizon",
    ) -> None:
        super().__init__(planner, speed_factor=speed_factor)
        self._gap, self._faster = float(gap), float(faster)
        self._done = Memory(1)

    def decide(self, batch: ActionBatch, seen: Seen) -> tuple[Floats, Ints]:
        """Return accelerations and lane changes; see `Driver`."""
        is_open = self._is_open(batch, seen)
        side, pace = self._target(batch, seen)
        cuts = is_open & self._is_in_front(batch, seen, side)
        change = np.where(cuts, side, self.demanded_change(batch, seen)).astype(np.int32)
        found = self.follow(seen)
        # Not faster than needed to get past, never against what the leader allows.
        wanted = self.model.acceleration(seen.speed, pace, np.inf, 0.0)
        return np.where(is_open & np.isfinite(pace), np.minimum(found, wanted), found), change

    def goal(self, batch: ActionBatch, seen: Seen, change: Ints) -> Goal:
        """Return the poses in front of the targets; for changes that the route demands, those of the base."""
        plain, lane = super().goal(batch, seen, change), beside(seen, change)
        lacking = np.maximum(self._gap + SPARE - lane[:, Lane.BEHIND], 0.0)
        time = np.clip(lacking / self._faster, SOONEST, LATEST)
        # The target's front is half of the own length and the gap behind the own centre.
        way = lane[:, Lane.BEHIND_SPEED] * time + lacking
        is_cut = self._is_open(batch, seen) & (lane[:, Lane.BEHIND] < LONGEST)
        cut = Goal(time, way, lane[:, Lane.BEHIND_SPEED])
        return Goal(*(np.where(is_cut, *pair) for pair in zip(cut, plain, strict=True)))

    def begun(self, batch: ActionBatch, seen: Seen, change: Ints) -> None:
        """Note that the cut-in has begun: it is the first change that the route does not demand."""
        done = self._done.of(batch)
        done[(change != 0) & self._is_open(batch, seen)] = 1.0
        self._done.keep(batch, done)

    def _is_open(self, batch: ActionBatch, seen: Seen) -> Bools:
        """Return whether the cut-in is to come, and the route demands no lane change now, shape (N,)."""
        return (self._done.of(batch)[:, 0] == 0.0) & (self.demanded_side(seen) == 0)

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

    def _is_in_front(self, batch: ActionBatch, seen: Seen, side: Ints) -> Bools:
        """Return whether the vehicle is past the target, which leaves room ahead until it is there."""
        lane = beside(seen, side)
        behind, ahead = lane[:, Lane.BEHIND], lane[:, Lane.AHEAD]
        is_close = (behind >= 0.0) & (behind < LONGEST)
        # The way over is that of the target and what is lacking of the gap.
        lacking = np.where(is_close, np.maximum(self._gap + SPARE - behind, 0.0), 0.0)
        closing = np.maximum(lane[:, Lane.BEHIND_SPEED] - lane[:, Lane.AHEAD_SPEED], 0.0)
        has_room = ahead - lacking > self.model.min_gap + closing * self.model.tau
        is_past = seen.speed >= lane[:, Lane.BEHIND_SPEED] - SLOWER
        # The vehicle is out of its own lane half-way.
        own_room = seen.lanes[:, OWN, Lane.AHEAD] > LEAST_GAP + 0.5 * lacking
        return may_change(batch, seen, side) & is_close & has_room & is_past & own_room
