"""The state of one shadow; `sumo_shadows` says what shadows are."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass


class Reinsertion(enum.Enum):
    """How a shadow is re-inserted into its lane."""

    BESIDE = enum.auto()
    """Via the lane that it straddles."""
    AND_BACK = enum.auto()
    """Via a neighbouring lane and back within one step."""
    OFF_THE_NET = enum.auto()
    """Off the net for one step."""


@dataclass
class Shadow:
    """The state of a shadow between steps."""

    id: str
    route: tuple[str, ...]
    """Planned route; empty if unknown."""
    lane: str = ""
    position: float = 0.0
    """Position of the front along the lane [m]."""
    front: tuple[float, float] = (math.nan, math.nan)
    """Middle of its front bumper as last given to SUMO [m]."""
    offset: float = 0.0
    """Offset of the front to the left of the lane's centreline [m]."""
    shift: float = 0.0
    """Shift to the left in SUMO, so that SUMO sees the vehicle in the lane of its tail [m]."""
    side: int = 0
    """The side on which the vehicle straddles another lane: 1 left, -1 right, 0 none."""
    noted_side: int = 0
    """The side that SUMO has detected."""
    way: tuple[str, ...] = ()
    """Edges that SUMO is to drive on from `lane` when it gets the vehicle back; empty: not settled yet."""
    back: float = 0.0
    """Offset at which SUMO is to get it back, with `way` [m]."""
    calm_steps: int = 0
    """Steps after its return to SUMO in which the vehicle begins no lane change."""
    reinsertion: Reinsertion | None = None
    """How to re-insert the vehicle in the next step, or None."""
