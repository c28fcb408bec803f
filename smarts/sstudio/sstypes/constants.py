"""Values that stand for "no limit" and "not said"."""

from __future__ import annotations

import sys
from collections.abc import Callable

MAX = sys.maxsize
"""No limit."""
MISSING = sys.maxsize
"""Stands for a value that is not given, where None would be a value."""

BASE_OFFSET, MAX_OFFSET, RANDOM_OFFSET = "base", "max", "random"
NAMED_OFFSETS = (BASE_OFFSET, MAX_OFFSET, RANDOM_OFFSET)
"""Named offsets along a lane: its begin, its end, a random one."""


def named_offset(name: str, low: float, high: float, draw: Callable[[float, float], float]) -> float:
    """Return the place of a named offset on a span [m]: its ends, or one drawn in between."""
    return float(draw(low, high)) if name == RANDOM_OFFSET else {BASE_OFFSET: low, MAX_OFFSET: high}[name]
