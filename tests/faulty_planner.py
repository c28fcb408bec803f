"""The receding-horizon planner with real failures of its solver in calls that a test chooses."""

import math
from collections.abc import Collection
from typing import ClassVar

import numpy as np

from smarts.planners import Limits, RecedingHorizonPlanner, optimal_control

STEPS = 8
"""Of the horizon: a lane change takes longer."""
HARD = np.array([[0.0, -30.0, 10.0 * side, math.pi - turn, 0.0] for side in (1, -1) for turn in (0, 0.7, 2)])
"""Added to targets."""


def _unconverged(limits):
    """Return a planner of one quadratic program, whose solver stops after one iteration."""
    settings = optimal_control._SOLVER
    piqp = {**settings["piqp"], "max_iter": 1}
    optimal_control._SOLVER = {**settings, "piqp": piqp}
    try:
        return RecedingHorizonPlanner(limits, steps=STEPS, iterations=1)
    finally:
        optimal_control._SOLVER = settings


class Faulty:
    """Plans as the receding horizon does, but for the calls that fail.

    "infeasible": the vehicle has to accelerate above its largest speed; "unconverged": the solver may take
    one iteration to a target behind the vehicle; "nan": the vehicle is nowhere.
    """

    fault: ClassVar[str] = "nan"
    failing: ClassVar[Collection[int]] = ()
    """Numbers of the calls that fail, of one vehicle."""
    plans: ClassVar[list] = []
    """Of each call."""

    def __init__(self, limits):
        self._good = RecedingHorizonPlanner(limits, steps=STEPS)
        must_accelerate = Limits(speed=0.0, acceleration=9.0, braking=-8.0)
        self._bad = {
            "infeasible": RecedingHorizonPlanner(must_accelerate, steps=STEPS),
            "unconverged": _unconverged(limits),
            "nan": self._good,
        }

    def plan(self, states, targets, neighbours=None, last=None, elapsed=0.0):
        found = None
        if len(self.plans) in self.failing:
            states = states if self.fault != "nan" else np.full_like(states, np.nan)
            # Of some hard targets one is too hard for a single iteration.
            for hard in HARD if self.fault == "unconverged" else (0.0,):
                found = self._bad[self.fault].plan(states, targets + hard, neighbours, last, elapsed)
                if found.status.all():
                    break
            assert found is not None
            assert found.status.all(), "the call does not fail"
        found = found or self._good.plan(states, targets, neighbours, last, elapsed)
        self.plans.append(found)
        return found
