"""Values that stand for "no limit" and "not said"."""

from __future__ import annotations

import sys

MAX = sys.maxsize
"""No limit."""
MISSING = sys.maxsize
"""Not said, where None would be a value."""

BASE_OFFSET, MAX_OFFSET, RANDOM_OFFSET = "base", "max", "random"
NAMED_OFFSETS = (BASE_OFFSET, MAX_OFFSET, RANDOM_OFFSET)
"""Named offsets along a lane: its begin, its end, a random one."""
