"""The receding-horizon planner, of which a test lets some calls fail."""

from collections.abc import Collection
from typing import ClassVar

import numpy as np

from smarts.planners import RecedingHorizonPlanner


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
