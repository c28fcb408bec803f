"""How agents' vehicles have moved within a step."""

from __future__ import annotations

from typing import NamedTuple

from smarts.arrays import Bytes, Floats
from smarts.types import columns


class Tracks(NamedTuple):
    """The motion of A agents' vehicles within a step; refilled in place by the next step."""

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
    def allocate(cls, worlds: int, agents: int, capacity: int, substeps: int) -> Tracks:
        """Return tracks at the origin that touch nothing, for B simulations of A agents and V slots."""
        more = {"poses": (substeps, 3), "touched": (capacity,), "touch_speed": (capacity,)}
        return columns.allocate(cls, (worlds, agents), more=more)
