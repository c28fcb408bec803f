"""Bubbles on their map: areas in which social agents take over traffic vehicles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from smarts.arrays import Bools, Floats, Ints
from smarts.types import columns
from smarts.types.condition_state import SceneCondition

UNLIMITED = 2**31 - 1
"""A limit that stands for none."""


@dataclass(frozen=True)
class PlacedBubble:
    """One bubble of a scenario, placed on its map.

    An outline is a tuple of closed rings, each of shape (., 2) [m]: a point is inside if it is inside an odd
    number of them. That of a moving bubble is as in the scenario's file, before it follows.
    """

    id: str
    actor: str
    """Name of its actor."""
    policy: int
    """Number of the social policy that drives; -1: the learning agents."""
    interface: int
    """Number of that policy's interface in the pool."""
    zone: tuple[Floats, ...]
    """Outline of the zone, in which agents drive."""
    margin: tuple[Floats, ...]
    """Outline of the zone with its margin, in which agents observe."""
    heights: tuple[float, float] = (-math.inf, math.inf)
    """Least and largest height of the zone's road [m]; infinite for a zone that is given without a road."""
    active_condition: SceneCondition | None = None
    """Holds while the bubble takes vehicles; None: always."""
    airlock_condition: SceneCondition | None = None
    """Condition on vehicles that come into the margin; None: all may."""
    hijack_limit: int = UNLIMITED
    """Largest number of vehicles that agents drive at a time, vehicles that are leaving included."""
    shadow_limit: int = UNLIMITED
    """Most vehicles at a time that agents drive or observe."""
    spared: tuple[str, ...] = ()
    """Prefixes of the names of vehicles that are left alone."""
    followed: str = ""
    """Name of the agent or vehicle with which the bubble travels; "" for a bubble that stays."""
    follow_offset: tuple[float, float] = (0.0, 0.0)
    """Offset of the zone's centre from the followed vehicle's, if the vehicle faced north [m]."""
    centroid: tuple[float, float] = (0.0, 0.0)
    """Centroid of the zone's outline [m]."""
    collision_time: float = 5.0
    """How long a vehicle that has collided in the bubble stays as an obstacle [s]."""
    period: int = 1
    """Steps from one decision of its agents to the next."""
    names: tuple[str, ...] = ()
    """Names of vehicles that its conditions look for."""


class BubbleStates(NamedTuple):
    """The bubbles of B simulations, Z at most in each: where they are, and what has happened in them."""

    pose: Floats
    """x, y [m] and angle [rad], shape (B, Z, 3): a point p of the outline in `PlacedBubble` is at
    R(angle) p + (x, y). Zero for a bubble that stays."""
    is_active: Bools
    """Whether the bubble takes vehicles: its condition holds, and the vehicle that it follows is there;
    shape (B, Z). So are the counts that follow."""
    taken: Ints
    """How often an agent began to drive a vehicle."""
    at_limit: Ints
    """How many vehicles a limit refused, each once for each time it came into the margin."""
    without_column: Ints
    """How many vehicles found all columns of the agents held."""
    not_drivable: Ints
    """How many vehicles are of a kind that agents cannot drive, counted as `at_limit`."""
    collided: Ints
    """How many vehicles have collided while an agent held them."""
    never_appeared: Ints
    """How many names that the bubble follows or that its conditions look for have not appeared so far."""

    @classmethod
    def allocate(cls, worlds: int, most: int) -> BubbleStates:
        """Return at most so many bubbles in each simulation, which rest."""
        return columns.allocate(cls, (worlds, most), more={"pose": (3,)})

    def clear(self, row: int) -> None:
        """Let the bubbles of one simulation rest, and forget what has happened."""
        columns.clear(self, row)

    def counted(self, row: int, bubbles: Sequence[PlacedBubble]) -> dict[str, dict[str, int]]:
        """Return the counts of one simulation by the id of the bubble and by name."""
        return {
            bubble.id: {name: int(getattr(self, name)[row, number]) for name in COUNTS}
            for number, bubble in enumerate(bubbles)
        }


COUNTS = BubbleStates._fields[2:]
"""Names of the counts of each bubble."""
