"""How agents' vehicles have moved within a step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.int8]
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Tracks:
    """What happened to the vehicles of A agents between two steps; refilled in place by the next one."""

    poses: Floats
    """x, y [m] and heading [rad] of the footprint after each sub-step, shape (B, A, S, 3); S is 0 where
    nothing has moved yet."""
    touched: Bytes
    """The first sub-step in which Bullet kept a vehicle and that of a slot from going into each other,
    counted from 1, 0 where it did not, shape (B, A, V). Bodies that dive or roll touch before their
    footprints do."""
    touch_speed: Floats
    """How fast the two approached each other then [m/s], 0 where they did not touch, shape (B, A, V)."""

    @classmethod
    def of(cls, poses: Floats, capacity: int) -> Tracks:
        """Return the tracks of vehicles that have touched nobody."""
        shape = (*poses.shape[:2], capacity)
        return cls(poses, np.zeros(shape, np.int8), np.zeros(shape))
