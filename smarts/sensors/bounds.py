"""Bounds of what sensors report: the same numbers for the declared spaces and for the kernels that clip."""

from __future__ import annotations

from smarts.geometry.compiling import kernel

FARTHEST = 1e7
"""Coordinates, distances [m]."""
FASTEST = 100.0
"""Speeds [m/s]."""
LARGEST_BOX = 100.0
"""Sides of vehicles [m]."""
FASTEST_TURN = 20.0
"""Rates of turning [rad/s]."""
HARDEST = 200.0
"""Accelerations [m/s^2]."""
HARDEST_TURN = 500.0
"""Angular accelerations [rad/s^2]."""
HARDEST_JERK = 4000.0
"""[m/s^3]"""
HARDEST_TURN_JERK = 10000.0
"""[rad/s^3]"""
MOST = 2**31 - 1
"""Numbers of lanes, slots, steps."""


@kernel
def clipped(value: float, most: float) -> float:
    """Return a value within -most and most; 0 for what is not a number."""
    if value > most:
        return most
    if value < -most:
        return -most
    # Only NaN is left that is not equal to itself.
    return value if value == value else 0.0


@kernel
def clipped_above(value: float, most: float) -> float:
    """Return a value within 0 and most; 0 for what is not a number."""
    return max(0.0, clipped(value, most))
