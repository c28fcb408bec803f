"""Motion of vehicles as messages `steps`: a few bytes for each vehicle and step.

A message holds K steps and can be read without those before it. A run is a vehicle that is there without a
gap; columns of more than one step are packed as runs. N is the number of rows: vehicles, summed over steps.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools, Ints
from smarts.stream.arrays import packed_array, packed_runs

PER_METRE = 100
"""Units of x, y and speed: 1 cm, 1 cm/s."""
PER_RADIAN = 1800 / math.pi
"""Units of angles: 0.1 degree."""
TURN = 3600
"""Units of a whole turn."""
OWNER_BITS = 0b111
BRAKES, LEFT, RIGHT, AIR_LOCK, LEAVING, COLLIDED = (1 << bit for bit in range(3, 9))
"""Bits of `Motion.flags`: brake light, turn indicators, in an air-lock, waits to go back to traffic, has
collided."""

_FARTHEST = float(1 << 30)
"""The largest number of units of any column."""
_UNITS = {"x": PER_METRE, "y": PER_METRE, "heading": PER_RADIAN, "speed": PER_METRE, "steer": PER_RADIAN}
"""Columns that are packed as runs."""


class Motion(NamedTuple):
    """Rows of vehicles and steps, shape (N,) each."""

    number: NDArray
    """The stream's short name of the vehicle."""
    step: NDArray
    x: NDArray
    """Position from the map's origin [m]."""
    y: NDArray
    heading: NDArray
    """Counter-clockwise from +x [rad]."""
    speed: NDArray
    """[m/s]"""
    steer: NDArray
    """Angle of the front wheels, positive to the left [rad]; 0 where unknown."""
    flags: NDArray
    """The owner in `OWNER_BITS`, and the bits behind."""


def steps_message(steps: Ints, motion: Motion, *, compress: bool = True) -> dict[str, Any]:
    """Return a message of some steps.

    Args:
        steps: Their numbers, increasing, shape (K,).
        motion: Motion of these steps, its rows in any order.
        compress: Whether to spend time on making it small.
    """
    order = np.lexsort((motion.step, motion.number))
    number, begin = motion.number[order], np.searchsorted(steps, motion.step[order])
    first = _first_of_runs(number, begin)
    starts = np.flatnonzero(first)

    def plain(values: NDArray, kind: type) -> dict[str, Any]:
        return packed_array(values.astype(kind), compress=compress)

    message = {
        "type": "steps",
        "step": plain(steps, np.int32),
        "number": plain(number[starts], np.uint32),
        "flags": plain(motion.flags[order], np.uint16),
    }
    if len(steps) > 1:
        message |= {
            "begin": plain(begin[starts], np.uint16),
            "count": plain(np.diff(starts, append=len(first)), np.uint16),
        }
    for name, per_unit in _UNITS.items():
        # Values that are not finite are of vehicles that failed: they stay where 0 is.
        units = getattr(motion, name)[order].astype(np.float64) * per_unit
        units = np.clip(np.nan_to_num(units, posinf=0.0, neginf=0.0), -_FARTHEST, _FARTHEST)
        whole = np.rint(units).astype(np.int32)
        message[name] = packed_runs(whole, first, turn=TURN if name == "heading" else 0, compress=compress)
    return message


def _first_of_runs(number: NDArray, place: NDArray) -> Bools:
    """Return which rows are the first of their run, shape (N,)."""
    first = np.ones(len(number), np.bool_)
    first[1:] = (number[1:] != number[:-1]) | (place[1:] != place[:-1] + 1)
    return first
