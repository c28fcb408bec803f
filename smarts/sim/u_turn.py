"""Guidance of U-turns into a lane of the opposite direction; kernels for one agent."""

from __future__ import annotations

import math

from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads
from smarts.roads.curves import curve_into, sharpest_bend, stations_of
from smarts.roads.turning import is_opposite, is_over_road, place_to_turn
from smarts.sim.places import beside, distance_between, lane_of
from smarts.types.guidance import GuidePhase
from smarts.types.world import State

LATERAL = 2.0
"""Lateral acceleration in the turn [m/s^2]."""
SLOW_ENOUGH = 0.5
"""Tolerance on the turning speed at which the turn may begin [m/s]."""
SIGHT = 100.0
"""How far ahead to look for a place to turn [m]."""
BRAKING = 1.5
"""Deceleration towards that place [m/s^2]."""

_FREE, _APPROACH, _MANOEUVRE = int(GuidePhase.FREE), int(GuidePhase.APPROACH), int(GuidePhase.MANOEUVRE)


@kernel
def plan_u_turn(state: State, roads: Roads, b: int, a: int) -> None:
    """Write the guidance of an agent that has not begun its U-turn; see `smarts.sstudio.types.UTurn`."""
    vehicles, missions, guidance = state.vehicles, state.missions, state.guidance
    slot = state.agents.slot[b, a]
    back = roads.lane_base[state.map[b]] + missions.task_lane[b, a]
    s, left = beside(vehicles, roads, b, slot, back)
    is_triggered = guidance.phase[b, a] == _APPROACH or _is_vehicle_near(
        state, roads, b, a, slot, roads.lane_edge[back]
    )
    guidance.phase[b, a], guidance.speed[b, a] = _FREE, missions.task_speed[b, a]
    if not is_triggered or s <= 0.0 or left <= 0.0:
        return
    begin = guidance.begin[b, a]
    begin[0], begin[1] = vehicles.position[b, slot]
    begin[2] = vehicles.heading[b, slot]
    control = curve_into(roads, begin, back, s)
    if not is_opposite(roads, begin[2], back, s):
        return
    pace = math.sqrt(LATERAL / sharpest_bend(control, stations_of(control)))
    if not is_over_road(roads, state.map[b], control, vehicles.height[b, slot]):
        ahead = _way_to_turn(state, roads, b, slot, back)
        if ahead >= 0.0:
            guidance.phase[b, a] = _APPROACH
            guidance.speed[b, a] = math.sqrt(pace * pace + 2.0 * BRAKING * ahead)
        return
    guidance.phase[b, a], guidance.speed[b, a] = _APPROACH, pace
    if vehicles.speed[b, slot] <= pace + SLOW_ENOUGH:
        guidance.phase[b, a] = _MANOEUVRE
        guidance.lane[b, a], guidance.s[b, a] = missions.task_lane[b, a], s


@kernel
def _way_to_turn(state: State, roads: Roads, b: int, slot: int, back: int) -> float:
    """Return the distance to the next place to turn into a lane [m], -1 if there is none within `SIGHT`."""
    lane = lane_of(state, roads, state.vehicles, b, slot)
    if lane < 0:
        return -1.0
    here = state.vehicles.lane_position[b, slot]
    place = place_to_turn(roads, state.map[b], lane, back, here, here + SIGHT)
    return place - here if place >= 0.0 else -1.0


@kernel
def _is_vehicle_near(state: State, roads: Roads, b: int, a: int, slot: int, edge: int) -> bool:
    """Return whether a vehicle on a road is within the task's radius of the agent's."""
    vehicles = state.vehicles
    for other in range(vehicles.alive.shape[1]):
        if vehicles.alive[b, other] and other != slot:
            lane = lane_of(state, roads, vehicles, b, other)
            is_there = lane >= 0 and roads.lane_edge[lane] == edge
            if is_there and distance_between(vehicles, b, slot, other) <= state.missions.task_radius[b, a]:
                return True
    return False
