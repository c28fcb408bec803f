"""Turning round: out of the lane and into one of the road of the other direction. Compiled, for one seat."""

from __future__ import annotations

import math

from smarts.geometry.compiling import kernel
from smarts.roads.curves import curve_into, sharpest_bend, stations_of
from smarts.roads.guide import Guide
from smarts.roads.turning import is_opposite, is_over_road
from smarts.sim.surroundings import Surroundings, beside, distance_between, lane_under
from smarts.types.guidance import GuidePhase

LATERAL = 2.0
"""Acceleration with which to turn [m/s^2]."""
SLOW_ENOUGH = 0.5
"""How much faster than that one may begin the turn [m/s]."""

_FREE, _APPROACH, _MANOEUVRE = int(GuidePhase.FREE), int(GuidePhase.APPROACH), int(GuidePhase.MANOEUVRE)


@kernel
def plan_u_turn(around: Surroundings, guide: Guide, b: int, a: int) -> None:
    """Write the guidance of an agent that is to turn and does not yet; see `smarts.sstudio.types.UTurn`."""
    slot = around.slot[b, a]
    back = around.roads.lane_base[around.map[b]] + around.task_lane[b, a]
    s, left = beside(around, b, slot, back)
    is_triggered = guide.phase[b, a] == _APPROACH or _is_anybody_near(around, b, a, slot, around.edge[back])
    guide.phase[b, a], guide.speed[b, a] = _FREE, around.task_speed[b, a]
    if not is_triggered or s <= 0.0 or left <= 0.0:
        return
    begin = guide.begin[b, a]
    begin[:2], begin[2] = around.position[b, slot], around.heading[b, slot]
    control = curve_into(around.roads, begin, back, s)
    if not is_opposite(around.roads, begin[2], back, s):
        return
    if not is_over_road(around.roads, around.map[b], control):
        return
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
