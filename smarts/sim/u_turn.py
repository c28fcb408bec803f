"""Turning round: out of the lane and into one of the road of the other direction. Compiled, for one seat."""

from __future__ import annotations

import math

import numpy as np

from smarts.geometry.compiling import kernel
from smarts.geometry.segments import segment_at
from smarts.roads.curves import curve_into, sharpest_bend, stations_of
from smarts.roads.guide import Guide
from smarts.roads.kernels import centre_at
from smarts.sim.surroundings import Surroundings, beside, distance_between, lane_under
from smarts.types.guidance import GuidePhase

LATERAL = 2.0
"""Acceleration with which to turn [m/s^2]."""
SLOW_ENOUGH = 0.5
"""How much faster than that one may begin the turn [m/s]."""
OPPOSITE = -0.7
"""Cosine of the angle between two roads that lead in other directions, at most."""

_FREE, _APPROACH, _MANOEUVRE = int(GuidePhase.FREE), int(GuidePhase.APPROACH), int(GuidePhase.MANOEUVRE)


@kernel
def plan_u_turn(around: Surroundings, guide: Guide, b: int, a: int) -> None:
    """Write the guidance of an agent that is to turn and does not yet; see `smarts.sstudio.types.UTurn`."""
    slot = around.slot[b, a]
    back = around.roads.lane_base[around.map[b]] + around.task_lane[b, a]
    s, left = beside(around, b, slot, back)
    is_triggered = guide.phase[b, a] == _APPROACH or _is_anybody_near(around, b, a, slot, around.edge[back])
    if not is_triggered or s <= 0.0 or left <= 0.0 or not _is_opposite(around, b, slot, back, s):
        guide.phase[b, a], guide.speed[b, a] = _FREE, around.task_speed[b, a]
        return
    begin = guide.begin[b, a]
    begin[:2], begin[2] = around.position[b, slot], around.heading[b, slot]
    control = curve_into(around.roads, begin, back, s)
    pace = math.sqrt(LATERAL / sharpest_bend(control, stations_of(control)))
    guide.phase[b, a], guide.speed[b, a] = _APPROACH, pace
    if around.speed[b, slot] <= pace + SLOW_ENOUGH:
        guide.phase[b, a] = _MANOEUVRE
        guide.lane[b, a], guide.s[b, a] = around.task_lane[b, a], s


@kernel
def _is_anybody_near(around: Surroundings, b: int, a: int, slot: int, edge: int) -> bool:
    """Tell whether a vehicle on a road is within the task's radius of the agent's."""
    for other in range(around.alive.shape[1]):
        if around.alive[b, other] and other != slot:
            lane = lane_under(around, b, other)
            is_there = lane >= 0 and around.edge[lane] == edge
            if is_there and distance_between(around, b, slot, other) <= around.task_radius[b, a]:
                return True
    return False


@kernel
def _is_opposite(around: Surroundings, b: int, slot: int, lane: int, s: float) -> bool:
    """Tell whether a lane leads the other way beside a vehicle."""
    roads = around.roads
    point = segment_at(roads.point_s, roads.point_start[lane], roads.point_start[lane + 1], s)
    heading = centre_at(roads, point, s)[2]
    return bool(np.cos(heading - around.heading[b, slot]) <= OPPOSITE)
