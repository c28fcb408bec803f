"""Gaps between vehicles in a lane, and whether one may follow another in them; compiled.

Whether a gap is enough is the safety criterion of MOBIL (Kesting, Treiber, Helbing, TRR 1999 (2007) 86-94):
a lane change must not make any driver brake harder than `SAFE_BRAKING`. The driver's deceleration is the
interaction term of the intelligent driver model (Treiber, Hennecke, Helbing, Phys. Rev. E 62 (2000) 1805),
with the parameters for towns in Treiber and Kesting, Traffic Flow Dynamics (2013), table 11.2.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads
from smarts.roads.lane_ways import place_on_lane
from smarts.roads.levels import meets
from smarts.sim.places import distance_between
from smarts.types.world import State

SAFE_BRAKING = 4.0
"""The hardest that anybody may have to brake [m/s^2]."""
ACCELERATION = 1.0
"""[m/s^2]"""
BRAKING = 1.5
"""Comfortable [m/s^2]."""
HEADWAY = 1.0
"""[s]"""
STANDSTILL_GAP = 2.0
"""[m]"""
FARTHEST = 100.0
"""Vehicles farther away are ignored [m]."""
ALONG = 0.5
"""Cosine of the angle between a vehicle and another, from which on they drive the same way."""


class Gaps(NamedTuple):
    """The nearest vehicles ahead of and behind a place in a lane, bumper to bumper; infinite for none."""

    ahead: float
    """[m]; negative where they overlap."""
    speed_ahead: float
    """[m/s]"""
    behind: float
    speed_behind: float


@kernel
def gaps_in(state: State, roads: Roads, b: int, slot: int, lane: int) -> Gaps:
    """Return the gaps that a vehicle has, or would have beside where it is, in a lane.

    A vehicle counts as in the lane if it drives along it and its footprint overlaps the lane, which is
    extended straight beyond both ends.
    """
    vehicles = state.vehicles
    x, y = vehicles.position[b, slot]
    own = place_on_lane(roads, lane, x, y, vehicles.height[b, slot])[0]
    ahead, behind, speed_ahead, speed_behind = np.inf, np.inf, 0.0, 0.0
    for other in range(vehicles.alive.shape[1]):
        if not meets(vehicles, b, slot, other) or distance_between(vehicles, b, slot, other) > FARTHEST:
            continue
        if math.cos(vehicles.heading[b, other] - vehicles.heading[b, slot]) < ALONG:
            continue
        x, y = vehicles.position[b, other]
        s, t = place_on_lane(roads, lane, x, y, vehicles.height[b, other])
        if abs(t) >= 0.5 * (roads.lane_width[lane] + vehicles.width[b, other]):
            continue
        gap = abs(s - own) - 0.5 * (vehicles.length[b, slot] + vehicles.length[b, other])
        if s > own and gap < ahead:
            ahead, speed_ahead = gap, vehicles.speed[b, other]
        elif s <= own and gap < behind:
            behind, speed_behind = gap, vehicles.speed[b, other]
    return Gaps(ahead, speed_ahead, behind, speed_behind)


@kernel
def may_follow(speed: float, leader_speed: float, gap: float, delay: float) -> bool:
    """Return whether a vehicle may be made to follow another.

    Args:
        speed: The follower's [m/s].
        leader_speed: [m/s]
        gap: Bumper to bumper [m].
        delay: Time before the follower reacts [s].
    """
    closing = speed - leader_speed
    return gap - max(closing, 0.0) * delay >= least_gap(speed, closing)


@kernel
def least_gap(speed: float, closing: float) -> float:
    """Return the gap in which one brakes as hard as anybody may have to [m].

    Args:
        speed: The follower's [m/s].
        closing: Its speed minus its leader's [m/s].
    """
    following = speed * HEADWAY + speed * closing / (2.0 * math.sqrt(ACCELERATION * BRAKING))
    wanted = STANDSTILL_GAP + max(following, 0.0)
    # The braking is ACCELERATION (wanted / gap)^2.
    return wanted * math.sqrt(ACCELERATION / SAFE_BRAKING)


@kernel
def pace_behind(leader_speed: float, gap: float) -> float:
    """Return the highest speed to stop behind a leader that brakes as hard [m/s], infinite for none.

    Krauss (Phys. Rev. E 55 (1997) 5597) with a reaction time of `HEADWAY`.

    Args:
        leader_speed: [m/s]
        gap: Bumper to bumper [m].
    """
    lag = BRAKING * HEADWAY
    square = lag * lag + leader_speed * leader_speed + 2.0 * BRAKING * (gap - STANDSTILL_GAP)
    return max(math.sqrt(max(square, 0.0)) - lag, 0.0)
