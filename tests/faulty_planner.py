"""Planners of tests: one of which a test lets some calls fail, one that waits."""

from collections.abc import Collection
from typing import ClassVar

import numpy as np

from smarts.planners import BezierPlanner, RecedingHorizonPlanner


class Faulty:
    """Plans as the receding horizon does, but for the calls that fail: the vehicle is nowhere in them."""

    failing: ClassVar[Collection[int]] = ()
    """Numbers of the calls that fail."""
    plans: ClassVar[list] = []
    """What each call has returned."""

    def __init__(self, limits):
        self._planner = RecedingHorizonPlanner(limits, steps=8)  # a lane change takes longer

    def plan(self, states, *more):
        if len(self.plans) in self.failing:
            states = np.full_like(states, np.nan)
        self.plans.append(self._planner.plan(states, *more))
        return self.plans[-1]


class Waiting(BezierPlanner):
    """Drives on beside its lane as long as there is a neighbour, then to the target."""

    def plan(self, states, targets, neighbours=None, last=None, elapsed=0.0):
        if neighbours is not None and np.isfinite(neighbours.path).any():
            targets = targets.copy()
            targets[:, 2], targets[:, 3] = states[:, 1], 0.0
        return super().plan(states, targets, neighbours, last, elapsed)
