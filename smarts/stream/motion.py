"""Motion of vehicles as messages `steps`: a few bytes for each vehicle and step.

A message holds K steps and can be read without those before it. A run is a vehicle that is there without a
gap; columns of more than one step are packed as runs. N is the number of rows: vehicles, summed over steps.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools, Floats, Ints
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
_COLUMNS = "x", "y", "heading", "speed", "steer"
"""Columns that are packed as runs."""


class Motion(NamedTuple):
    """Rows of vehicles and steps, ordered by number, then step; shape (N,) each."""

    number: Ints
    """The stream's short name of the vehicle."""
    step: Ints
    x: Ints
    """Position from the map's origin [cm]."""
    y: Ints
    heading: Ints
    """Counter-clockwise from +x [0.1 degree]."""
    speed: Ints
    """[cm/s]"""
    steer: Ints
    """Angle of the front wheels, positive to the left [0.1 degree]; 0 where unknown."""
    flags: NDArray[np.uint16]
    """The owner in `OWNER_BITS`, and the bits behind."""

    @classmethod
    def of(
        cls,
        number: NDArray,
        step: NDArray,
        position: Floats,
        heading: NDArray,
        speed: NDArray,
        steer: NDArray,
        flags: NDArray,
    ) -> Motion:
        """Return rows from SI units, in any order; `position` is relative to the origin, shape (N, 2)."""
        order = np.lexsort((step, number))

        def whole(values: NDArray, per_unit: float) -> Ints:
            # Values that are not finite are of vehicles that failed: they stay where 0 is.
            units = np.nan_to_num(values[order].astype(np.float64) * per_unit, posinf=0.0, neginf=0.0)
            return np.rint(np.clip(units, -_FARTHEST, _FARTHEST)).astype(np.int32)

        return cls(
            number[order].astype(np.int32),
            step[order].astype(np.int32),
            whole(position[:, 0], PER_METRE),
            whole(position[:, 1], PER_METRE),
            whole(heading, PER_RADIAN),
            whole(speed, PER_METRE),
            whole(steer, PER_RADIAN),
            flags[order].astype(np.uint16),
        )


def steps_message(steps: Ints, motion: Motion, *, compress: bool = True) -> dict[str, Any]:
    """Return a message of some steps.

    Args:
        steps: Their numbers, increasing, shape (K,).
        motion: Motion of these steps.
        compress: Whether to spend time on making it small.
    """
    begin = np.searchsorted(steps, motion.step)
    first = _first_of_runs(motion.number, begin)
    starts = np.flatnonzero(first)

    def plain(values: NDArray, kind: type) -> dict[str, Any]:
        return packed_array(values.astype(kind), compress=compress)

    message = {
        "type": "steps",
        "step": plain(steps, np.int32),
        "number": plain(motion.number[starts], np.uint32),
        "flags": plain(motion.flags, np.uint16),
    }
    if len(steps) > 1:
        message |= {
            "begin": plain(begin[starts], np.uint16),
            "count": plain(np.diff(starts, append=len(first)), np.uint16),
        }
    return message | {
        name: packed_runs(
            getattr(motion, name), first, turn=TURN if name == "heading" else 0, compress=compress
        )
        for name in _COLUMNS
    }


def _first_of_runs(number: NDArray, place: NDArray) -> Bools:
    """Return which rows are the first of their run, shape (N,)."""
    first = np.ones(len(number), np.bool_)
    first[1:] = (number[1:] != number[:-1]) | (place[1:] != place[:-1] + 1)
    return first
