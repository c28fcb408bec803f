"""Cutting in: past a vehicle in the lane beside, and over in front of it. Compiled, for one agent."""

from __future__ import annotations

import numpy as np

from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads
from smarts.sim.gaps import gaps_in, least_gap, may_follow, pace_behind
from smarts.sim.places import beside, distance_between, lane_of
from smarts.types.guidance import GuidePhase
from smarts.types.world import State

AHEAD = 15.0
"""How far ahead of the other vehicle to go over, from centre to centre; the middle of a shorter gap [m]."""
NEAR_ENOUGH = 1.5
"""Largest deviation from that [m]."""
GAIN = 0.5
"""Speed above the other vehicle's for each metre that is lacking [1/s]."""
SLOWEST = 2.5
"""Even beside a vehicle that stands [m/s]."""
FASTER = 1.1
"""Times the other's speed, while going over."""
CHANGE_TIME = 3.0
"""Duration of the lane change [s]."""
LEAST_LENGTH = 15.0
"""Least length of the lane change, along the road [m]."""
STANDING = 1e-6
"""Stands for speed 0 in the guidance, where 0 stands for no speed given [m/s]."""

_FREE, _APPROACH = int(GuidePhase.FREE), int(GuidePhase.APPROACH)
_MANOEUVRE, _OVER = int(GuidePhase.MANOEUVRE), int(GuidePhase.OVER)


@kernel
def plan_cut_in(state: State, roads: Roads, b: int, a: int) -> None:
    """Write the guidance of an agent that is to cut in and does not yet; see `smarts.sstudio.types.CutIn`."""
    vehicles, guidance = state.vehicles, state.guidance
    slot = state.agents.slot[b, a]
    lane, last = lane_of(state, roads, vehicles, b, slot), state.missions.task_lane[b, a]
    if lane < 0:
        return
    if last >= 0 and roads.lane_edge[roads.lane_base[state.map[b]] + last] == roads.lane_edge[lane]:
        guidance.phase[b, a], guidance.speed[b, a] = _OVER, 0.0
        return
    target = _target_of(state, roads, b, a, slot, lane)
    guidance.target[b, a] = target
    if target < 0:
        guidance.phase[b, a], guidance.speed[b, a] = _FREE, 0.0
        return
    guidance.target_generation[b, a] = vehicles.generation[b, target]
    speed, own_speed = vehicles.speed[b, target], vehicles.speed[b, slot]
    own = gaps_in(state, roads, b, slot, lane)
    if not _is_beside(state, roads, b, lane, target):
        # One of the two has come to another road before the other.
        guidance.phase[b, a] = _APPROACH
        guidance.speed[b, a] = _limited_by_leader(max(speed, SLOWEST), own.ahead, own.speed_ahead)
        return
    other_lane = lane_of(state, roads, vehicles, b, target)
    place, left = beside(vehicles, roads, b, slot, other_lane)
    its_place = vehicles.lane_position[b, target]
    between = gaps_in(state, roads, b, target, other_lane).ahead + vehicles.length[b, target]
    lacking = min(AHEAD, 0.5 * between) - (place - its_place)
    pace = min(max(speed + GAIN * lacking, 0.5 * speed), 2.0 * speed)
    guidance.phase[b, a] = _APPROACH
    guidance.speed[b, a] = _limited_by_leader(max(pace, SLOWEST), own.ahead, own.speed_ahead)
    length = max(LEAST_LENGTH, CHANGE_TIME * own_speed)
    if abs(lacking) > NEAR_ENOUGH or length > left:
        return
    gaps = gaps_in(state, roads, b, slot, other_lane)
    # Until the change is complete, the gap ahead in its own lane has to suffice, too.
    is_safe = may_follow(own_speed, gaps.speed_ahead, gaps.ahead, 0.5 * CHANGE_TIME)
    is_safe &= may_follow(gaps.speed_behind, own_speed, gaps.behind, 0.5 * CHANGE_TIME)
    if is_safe and may_follow(own_speed, own.speed_ahead, own.ahead, 0.5 * CHANGE_TIME):
        guidance.phase[b, a] = _MANOEUVRE
        guidance.begin[b, a, 0], guidance.begin[b, a, 1] = vehicles.position[b, slot]
        guidance.begin[b, a, 2] = vehicles.heading[b, slot]
        guidance.lane[b, a], guidance.s[b, a] = vehicles.lane[b, target], place + length
        guidance.speed[b, a] = _limited_by_leader(max(FASTER * speed, SLOWEST), gaps.ahead, gaps.speed_ahead)


@kernel
def pace_cut_in(state: State, roads: Roads, b: int, a: int) -> None:
    """Write the speed during a cut-in: 1.1 times the target vehicle's, limited by the leader ahead."""
    vehicles, guidance = state.vehicles, state.guidance
    slot, target = state.agents.slot[b, a], guidance.target[b, a]
    pace = max(guidance.speed[b, a], SLOWEST)
    if vehicles.alive[b, target] and vehicles.generation[b, target] == guidance.target_generation[b, a]:
        pace = max(pace, FASTER * vehicles.speed[b, target])
    lane = roads.lane_base[state.map[b]] + guidance.lane[b, a]
    gaps = gaps_in(state, roads, b, slot, lane)
    guidance.speed[b, a] = _limited_by_leader(pace, gaps.ahead, gaps.speed_ahead)


@kernel
def _limited_by_leader(pace: float, gap: float, speed: float) -> float:
    """Return a speed limited by the leader at a gap [m] and a speed [m/s]."""
    return max(min(pace, pace_behind(speed, gap)), STANDING)


@kernel
def _is_beside(state: State, roads: Roads, b: int, lane: int, other: int) -> bool:
    """Return whether a vehicle is in a lane to the left or right of a lane outside junctions."""
    its = lane_of(state, roads, state.vehicles, b, other)
    is_neighbour = its >= 0 and (its == roads.lane_left[lane] or its == roads.lane_right[lane])
    return is_neighbour and not roads.lane_inside[lane]


@kernel
def _target_of(state: State, roads: Roads, b: int, a: int, slot: int, lane: int) -> int:
    """Return the vehicle to cut in on, -1 for none: the one chosen before, else the nearest beside.

    A vehicle stays chosen while it is within the radius and not in the agent's own lane; a vehicle with room
    before it is preferred.
    """
    vehicles, guidance = state.vehicles, state.guidance
    radius, known = state.missions.task_radius[b, a], int(guidance.target[b, a])
    if known >= 0 and vehicles.alive[b, known]:
        is_same = vehicles.generation[b, known] == guidance.target_generation[b, a]
        is_here = distance_between(vehicles, b, slot, known) <= radius
        its_lane = lane_of(state, roads, vehicles, b, known)
        if not is_same or not is_here or its_lane == lane:
            known = -1
        elif its_lane < 0 or _has_room(state, roads, b, slot, known):
            return known
    else:
        known = -1
    nearest, found, is_found_roomy = np.inf, known, False
    for other in range(vehicles.alive.shape[1]):
        if vehicles.alive[b, other] and other != slot and _is_beside(state, roads, b, lane, other):
            distance = distance_between(vehicles, b, slot, other)
            if distance > radius:
                continue
            is_roomy = _has_room(state, roads, b, slot, other)
            is_nearer = distance < nearest and is_roomy == is_found_roomy
            if (is_roomy and not is_found_roomy) or (is_nearer and (is_roomy or known < 0)):
                nearest, found, is_found_roomy = distance, other, is_roomy
    return found


@kernel
def _has_room(state: State, roads: Roads, b: int, slot: int, other: int) -> bool:
    """Return whether a vehicle fits in before another that is in a lane, when all there are equally fast."""
    vehicles = state.vehicles
    gap = gaps_in(state, roads, b, other, lane_of(state, roads, vehicles, b, other)).ahead
    return 0.5 * (gap - vehicles.length[b, slot]) >= least_gap(vehicles.speed[b, other], 0.0)
