"""The agents `mobil-v0` and `aggressive-v0`."""

from __future__ import annotations

import math

import numpy as np

from smarts.agents.policy import ActionBatch
from smarts.arrays import Floats, Ints
from smarts.observations.surroundings import OWN, Lane, Own
from smarts.zoo.driving import HORIZON_TIME, SAFE_BRAKING, STEP, Driver, Memory, Seen, beside

SETTLING = 3.0
"""Time between two lane changes of a driver's own choice [s]."""


class MobilDriver(Driver):
    """Changes lanes by MOBIL, where it gains more than the others lose, and where its route demands it.

    Args:
        tau: As of `Driver`, as are the next five.
        accel: See `tau`.
        decel: See `tau`.
        min_gap: See `tau`.
        speed_factor: See `tau`.
        max_speed: See `tau`.
        politeness: Weight of the others' accelerations.
        threshold: Least gain [m/s^2].
        bias_right: Gain of a lane farther right [m/s^2].
        safe_braking: The hardest that a change may make anyone brake [m/s^2].
        junction_margin: As of `Driver`.
    """

    def __init__(
        self,
        tau: float = 1.2,
        accel: float = 2.0,
        decel: float = 3.0,
        min_gap: float = 2.0,
        speed_factor: float = 1.0,
        max_speed: float = math.inf,
        politeness: float = 0.3,
        threshold: float = 0.2,
        bias_right: float = 0.0,
        safe_braking: float = SAFE_BRAKING,
        junction_margin: float = 1.0,
    ) -> None:
        super().__init__(tau, accel, decel, min_gap, speed_factor, max_speed, junction_margin)
        self._politeness, self._threshold = float(politeness), float(threshold)
        self._bias_right, self._safe_braking = float(bias_right), float(safe_braking)
        self._last_change = Memory(1)

    def decide(self, batch: ActionBatch, seen: Seen) -> tuple[Floats, Ints]:
        """Return accelerations and lane changes; see `Driver`."""
        last = self._last_change.of(batch)
        last[self._last_change.is_new(batch)] = -math.inf
        demanded = self.demanded_change(batch, seen)
        is_free = (seen.own[:, Own.DEMANDED] == 0.0) & (batch.step - last[:, 0] > SETTLING / STEP)
        chosen = np.where(is_free, self._best_side(batch, seen), 0)
        change = np.where(demanded != 0, demanded, chosen).astype(np.int32)
        last[change != 0, 0] = batch.step[change != 0]
        self._last_change.keep(batch, last)
        return self.follow(seen), change

    def _best_side(self, batch: ActionBatch, seen: Seen) -> Ints:
        """Return the side with the larger gain above the threshold, 0 for none, shape (N,)."""
        count = len(seen.own)
        gains = []
        for side in (1, -1):
            sides = np.full(count, side, np.int32)
            is_possible = self.is_safe(batch, seen, sides, self._safe_braking)
            # A lane that ends soon, or leaves the route, is no way out.
            is_possible &= beside(seen, sides)[:, Lane.LEFT] > HORIZON_TIME * seen.speed
            gain = self.incentive(seen, sides) - side * self._bias_right
            gains.append(np.where(is_possible, gain, -np.inf))
        left, right = gains
        best = np.maximum(left, right)
        return np.where(best > self._threshold, np.where(left >= right, 1, -1), 0).astype(np.int32)

    def incentive(self, seen: Seen, side: Ints) -> Floats:
        """Return what lane changes gain, with the weighted gains of both followers [m/s^2], shape (N,).

        Kesting, Treiber, Helbing, "General lane-changing model MOBIL", TRR 1999 (2007) 86, eq. 2:
        a_c' - a_c + p (a_n' - a_n + a_o' - a_o), c the driver, n the new follower, o the old one.
        """
        own, new = seen.lanes[:, OWN], beside(seen, side)
        speed, length, desired = seen.speed, seen.own[:, Own.LENGTH], self.desired(seen)

        def behind(lane: Floats, gap: Floats, leader_speed: Floats) -> Floats:
            """Return the acceleration of a lane's follower; 0 if there is none."""
            its_speed = lane[:, Lane.BEHIND_SPEED]
            its_desired = np.maximum(lane[:, Lane.BEHIND_DESIRED], its_speed)
            found = self.model.acceleration(its_speed, its_desired, gap, leader_speed)
            return np.where(np.isfinite(lane[:, Lane.BEHIND]), found, 0.0)

        before = self.model.acceleration(speed, desired, own[:, Lane.AHEAD], own[:, Lane.AHEAD_SPEED])
        after = self.model.acceleration(speed, desired, new[:, Lane.AHEAD], new[:, Lane.AHEAD_SPEED])
        without = [lane[:, Lane.BEHIND] + length + lane[:, Lane.AHEAD] for lane in (own, new)]
        old_gain = behind(own, without[0], own[:, Lane.AHEAD_SPEED]) - behind(own, own[:, Lane.BEHIND], speed)
        new_gain = behind(new, new[:, Lane.BEHIND], speed) - behind(new, without[1], new[:, Lane.AHEAD_SPEED])
        return after - before + self._politeness * (new_gain + old_gain)


class AggressiveDriver(MobilDriver):
    """Drives 20% above the limit, close behind leaders, and takes small gaps, beside it and at junctions.

    That is by the options of `aggressive-v0` in the zoo; without them it is a `MobilDriver`.
    """
