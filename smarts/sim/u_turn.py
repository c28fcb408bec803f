"""Turning round: out of the lane and into one of the road of the other direction. Compiled, for one agent."""

from __future__ import annotations

import math

from smarts.geometry.compiling import kernel
from smarts.roads.curves import curve_into, sharpest_bend, stations_of
from smarts.roads.guide import Guide
from smarts.roads.turning import is_opposite, is_over_road, place_to_turn
from smarts.sim.surroundings import Surroundings, beside, distance_between, lane_under
from smarts.types.guidance import GuidePhase

LATERAL = 2.0
"""Acceleration with which to turn [m/s^2]."""
SLOW_ENOUGH = 0.5
"""How much faster than that one may begin the turn [m/s]."""
SIGHT = 100.0
"""How far ahead to look for a place to turn where there is none here [m]."""
BRAKING = 1.5
"""With which to slow down towards it [m/s^2]."""

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
    begin[0], begin[1] = around.position[b, slot]
    begin[2] = around.heading[b, slot]
    control = curve_into(around.roads, begin, back, s)
    if not is_opposite(around.roads, begin[2], back, s):
        return
    pace = math.sqrt(LATERAL / sharpest_bend(control, stations_of(control)))
    if not is_over_road(around.roads, around.map[b], control):
        ahead = _way_to_turn(around, b, slot, back)
        if ahead >= 0.0:
            guide.phase[b, a] = _APPROACH
            guide.speed[b, a] = math.sqrt(pace * pace + 2.0 * BRAKING * ahead)
        return
    guide.phase[b, a], guide.speed[b, a] = _APPROACH, pace
    if around.speed[b, slot] <= pace + SLOW_ENOUGH:
        guide.phase[b, a] = _MANOEUVRE
        guide.lane[b, a], guide.s[b, a] = around.task_lane[b, a], s


@kernel
def _way_to_turn(around: Surroundings, b: int, slot: int, back: int) -> float:
    """Return how far ahead a vehicle can turn into a lane [m], as beside a median; -1 for nowhere here."""
    lane = lane_under(around, b, slot)
    if lane < 0:
        return -1.0
    here = around.lane_position[b, slot]
    place = place_to_turn(around.roads, around.map[b], lane, back, here, here + SIGHT)
    return place - here if place >= 0.0 else -1.0


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
