"""The feature `car_following`."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools, Floats
from smarts.observations.feature import Feature
from smarts.observations.scales import SPEED_SCALE
from smarts.observations.surroundings import Lane, Own, Surroundings

FARTHEST = 150.0
"""Gaps are cut at this [m]."""
LONGEST = 20.0
"""Length of the longest vehicles [m]."""


class CarFollowing(Feature):
    """What models of car following read: the leader, speed limit, the lane's end, own speed and length.

    The numbers: whether there is a leader on the way (the lanes of the route); its gap, compressed; the own
    speed as a share of itself and the gap in one second, v / (v + gap); the leader's speed less the own one,
    compressed; the speed that limits ahead allow; nearness of the lane's end; own speed; own length.
    """

    size: ClassVar[int] = 8

    def bind(self, *out: NDArray) -> Callable[[Bools], object]:
        """Return the function that observes; see `Feature`."""
        surroundings = Surroundings(self.context)
        worlds, agents = out[0].shape[:2]
        own, lanes = (field.allocate(worlds, agents) for field in surroundings.fields())
        see = surroundings.bind(own, lanes)

        def observe(observe_mask: Bools) -> None:
            see(observe_mask)
            out[0][observe_mask] = _numbers(own[observe_mask], lanes[observe_mask][:, 0])

        return observe


def _numbers(own: Floats, lane: Floats) -> Floats:
    """Return the numbers of N vehicles, shape (N, 8)."""
    speed, gap = np.maximum(own[:, Own.SPEED], 0.0), lane[:, Lane.AHEAD]
    has_leader = np.isfinite(gap)
    gap = np.clip(np.where(has_leader, gap, FARTHEST), 0.0, FARTHEST)
    faster = np.where(has_leader, lane[:, Lane.AHEAD_SPEED] - speed, 0.0)
    numbers = (
        has_leader,
        _compressed(gap, FARTHEST),
        speed / (speed + gap + 0.1),
        _compressed(faster, SPEED_SCALE),
        own[:, Own.ALLOWED] / SPEED_SCALE,
        1.0 - np.minimum(lane[:, Lane.LEFT], FARTHEST) / FARTHEST,
        speed / SPEED_SCALE,
        own[:, Own.LENGTH] / LONGEST,
    )
    return np.clip(np.column_stack(numbers), -1.0, 1.0)


def _compressed(values: Floats, largest: float) -> Floats:
    """Return lengths or speeds as `scales.compressed` has them."""
    sizes = np.log1p(np.minimum(np.abs(values), largest)) / np.log1p(largest)
    return np.copysign(sizes, values)
