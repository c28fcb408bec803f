"""Scales of features.

Relative positions and velocities are compressed (`compressed`): a goal one lane aside is 3 m in 200 m, a
neighbor in the next lane 3 m in 50 m, and on a linear scale learners take long to notice either.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Floats
from smarts.geometry.compiling import kernel

GOAL_SCALE = 200.0
"""The largest distance to the goal ahead and aside [m]."""
SPEED_SCALE = 30.0
"""The largest speed, and velocity relative to a neighbor [m/s]."""
STEERING_SCALE = 0.6
"""[rad]"""
RADIUS = 50.0
"""Within which neighbors are observed [m]."""
SIGHT = 100.0
"""Within which junctions, and vehicles that come to them, are observed [m]."""
LONGEST_TIME = 5.0
"""Times to collision are cut at this [s]."""
MOST_LANE_CHANGES = 3
"""More count as this many."""


@kernel
def clipped(value: float) -> float:
    """Return a number cut at -1 and 1."""
    return min(1.0, max(-1.0, value))


@kernel
def compressed(value: float, largest: float) -> float:
    """Return a length or speed on a logarithmic scale, 1 for `largest` and more.

    That is sign(x) ln(1 + |x|), the symlog of Hafner et al. 2023, "Mastering Diverse Domains through World
    Models", eq. 9, divided by its largest value; `expanded` takes it back.
    """
    return math.copysign(math.log1p(min(abs(value), largest)) / math.log1p(largest), value)


def expanded(feature: NDArray, largest: float) -> Floats:
    """Return the lengths or speeds that `compressed` made these features of."""
    feature = np.asarray(feature, np.float64)
    return np.sign(feature) * np.expm1(np.abs(feature) * math.log1p(largest))
