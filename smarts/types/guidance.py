"""Guidance: where a mission's task leads its agent now, as arrays."""

from __future__ import annotations

import enum
from typing import NamedTuple

from smarts.arrays import Bytes, Floats, Ints
from smarts.types import columns


class GuidePhase(enum.IntEnum):
    """How far a task has come."""

    FREE = 0
    """The mission has no task, or nothing has triggered it: the agent follows lanes as usual."""
    APPROACH = 1
    """Triggered: the agent keeps its lane, at the speed that the manoeuvre takes."""
    MANOEUVRE = 2
    """The agent follows a curve out of its lane into another."""
    OVER = 3
    """The agent has performed its task and stays free."""


_NONE_IS_MINUS_ONE = ("lane", "target")


class Guidance(NamedTuple):
    """Guidance of B simulations, shape (B, A); written with the lanes, read by sensors and controllers."""

    phase: Bytes
    """A `GuidePhase`."""
    speed: Floats
    """The speed to drive at [m/s], 0 where the task does not say."""
    begin: Floats
    """Begin of the curve: x, y [m], heading [rad], shape (B, A, 3)."""
    lane: Ints
    """The lane that the curve leads into, -1 without a curve."""
    s: Floats
    """End of the curve along that lane [m]."""
    target: Ints
    """Slot of the vehicle that the task is about, -1 for none."""
    target_generation: Ints
    """Its generation; with the slot, the vehicle itself."""

    @classmethod
    def allocate(cls, worlds: int, agents: int) -> Guidance:
        """Return no guidance for B simulations of A agents."""
        return columns.allocate(cls, (worlds, agents), _NONE_IS_MINUS_ONE, {"begin": (3,)})

    def clear(self, row: int) -> None:
        """Forget the guidance of one simulation."""
        columns.clear(self, row, _NONE_IS_MINUS_ONE)
