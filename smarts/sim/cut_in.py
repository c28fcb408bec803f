"""Cutting in: past a vehicle in the lane beside, and over in front of it. Compiled, for one seat."""

from __future__ import annotations

import numpy as np

from smarts.geometry.compiling import kernel
from smarts.roads.guide import Guide
from smarts.sim.surroundings import Surroundings, beside, distance_between, lane_under
from smarts.types.guidance import GuidePhase

AHEAD = 15.0
"""How far ahead of the other vehicle to go over, from centre to centre [m]."""
NEAR_ENOUGH = 1.5
"""How much that may be missed by [m]."""
GAIN = 0.5
"""By how much faster than the other vehicle to drive for each metre that is lacking [1/s]."""
SLOWEST = 2.5
"""Even beside a vehicle that stands [m/s]."""
FASTER = 1.1
"""Times the other's speed, while going over."""
CHANGE_TIME = 3.0
"""How long going over takes [s]."""
LEAST_LENGTH = 15.0
"""Of the way over, along the road [m]."""

_FREE, _APPROACH = int(GuidePhase.FREE), int(GuidePhase.APPROACH)
_MANOEUVRE, _OVER = int(GuidePhase.MANOEUVRE), int(GuidePhase.OVER)


@kernel
def plan_cut_in(around: Surroundings, guide: Guide, b: int, a: int) -> None:
    """Write the guidance of an agent that is to cut in and does not yet; see `smarts.sstudio.types.CutIn`."""
    slot = around.slot[b, a]
    lane, last = lane_under(around, b, slot), around.task_lane[b, a]
    if lane < 0:
        return
    if last >= 0 and around.edge[around.roads.lane_base[around.map[b]] + last] == around.edge[lane]:
        guide.phase[b, a], guide.speed[b, a] = _OVER, 0.0
        return
    target = _target_of(around, guide, b, a, slot, lane)
    guide.target[b, a] = target
    if target < 0:
        guide.phase[b, a], guide.speed[b, a] = _FREE, 0.0
        return
    guide.target_generation[b, a] = around.generation[b, target]
    if not _is_beside(around, b, lane, target):
        # One of the two has come to another road before the other.
        return
    speed = around.speed[b, target]
    other_lane = lane_under(around, b, target)
    place, left = beside(around, b, slot, other_lane)
    lacking = AHEAD - (place - around.lane_position[b, target])
    pace = min(max(speed + GAIN * lacking, 0.5 * speed), 2.0 * speed)
    guide.phase[b, a], guide.speed[b, a] = _APPROACH, max(pace, SLOWEST)
    length = max(LEAST_LENGTH, CHANGE_TIME * around.speed[b, slot])
    if abs(lacking) <= NEAR_ENOUGH and length <= left:
        guide.phase[b, a], guide.speed[b, a] = _MANOEUVRE, max(FASTER * speed, SLOWEST)
        guide.begin[b, a, :2], guide.begin[b, a, 2] = around.position[b, slot], around.heading[b, slot]
        guide.lane[b, a], guide.s[b, a] = around.lane[b, target], place + length


@kernel
def _is_beside(around: Surroundings, b: int, lane: int, other: int) -> bool:
    """Tell whether a vehicle is in a lane to the left or right of a lane outside junctions."""
    its = lane_under(around, b, other)
    is_neighbour = its >= 0 and (its == around.left[lane] or its == around.right[lane])
    return is_neighbour and not around.roads.lane_inside[lane]


@kernel
def _target_of(around: Surroundings, guide: Guide, b: int, a: int, slot: int, lane: int) -> int:
    """Return the vehicle to cut in on, -1 for none: the one chosen before, else the nearest beside.

    One stays chosen as long as it is within the radius and not in the agent's own lane.
    """
    radius, known = around.task_radius[b, a], guide.target[b, a]
    if known >= 0 and around.alive[b, known]:
        is_same = around.generation[b, known] == guide.target_generation[b, a]
        is_here = distance_between(around, b, slot, known) <= radius
        if is_same and is_here and lane_under(around, b, known) != lane:
            return int(known)
    nearest, found = np.inf, -1
    for other in range(around.alive.shape[1]):
        if around.alive[b, other] and other != slot and _is_beside(around, b, lane, other):
            distance = distance_between(around, b, slot, other)
            if distance <= radius and distance < nearest:
                nearest, found = distance, other
    return found
