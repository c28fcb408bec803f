"""Room for a vehicle that is put into traffic: the vehicles that have too little distance from it."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from smarts.geometry.boxes import boxes_overlap
from smarts.roads.lane_graph import HEIGHT_REACH, LaneGraph
from smarts.types.vehicles import Owner, VehicleStates

BRAKING = 3.0
"""Deceleration that suffices for the driver behind [m/s^2]."""
REACTION = 1.0
"""Reaction time of that driver [s]."""
MARGIN = (10.0, 1.0)
"""Kept free before and behind, and on either side, whatever the speeds [m]."""


def vehicles_in_the_way(
    roads: LaneGraph, states: VehicleStates, slot: int, leads_here: Callable[[int], bool] = lambda other: True
) -> list[int]:
    """Return the slots of traffic vehicles that are too near to a vehicle.

    These are the vehicles within `MARGIN`, those that would have to brake harder than `BRAKING` for the
    vehicle, and those for which the vehicle would have to.

    Args:
        roads: The map.
        states: The vehicles of one simulation, located.
        slot: The vehicle's.
        leads_here: Returns whether the vehicle in a slot, behind on another lane, is going to this lane.
    """
    is_level = ~(np.abs(states.height - states.height[slot]) > HEIGHT_REACH)
    others = np.flatnonzero(states.alive & (states.owner != Owner.AGENT) & is_level)
    others = others[others != slot]
    if not len(others):
        return []
    size = np.array([[states.length[slot], states.width[slot]]]) + 2 * np.array(MARGIN)
    blocked = boxes_overlap(
        states.position[[slot]],
        states.heading[[slot]],
        size,
        states.position[others],
        states.heading[others],
        np.stack([states.length[others], states.width[others]], -1),
    )
    found = set(others[blocked].tolist())
    speed, half = float(states.speed[slot]), float(states.length[slot]) / 2
    fastest = float(states.speed[others].max(initial=0.0))
    for other, distance in _along(roads, states, slot, others, needed_gap(speed, 0.0), ahead=True):
        gap = distance - half - float(states.length[other]) / 2
        if gap < needed_gap(speed, float(states.speed[other])):
            found.add(other)
    for other, distance in _along(roads, states, slot, others, needed_gap(fastest, speed), ahead=False):
        gap = distance - half - float(states.length[other]) / 2
        if gap < needed_gap(float(states.speed[other]), speed) and leads_here(other):
            found.add(other)
    return sorted(found)


def needed_gap(behind: float, ahead: float) -> float:
    """Return the gap [m] in which a driver comes down to the speed of the vehicle ahead [m/s]."""
    return REACTION * behind + max(0.0, behind**2 - ahead**2) / (2 * BRAKING)


def _along(
    roads: LaneGraph,
    states: VehicleStates,
    slot: int,
    others: NDArray[np.intp],
    horizon: float,
    *,
    ahead: bool,
) -> list[tuple[int, float]]:
    """Return the vehicles on the lanes ahead (or behind), with the distance of the centres [m]."""
    home, s = int(states.lane[slot]), float(states.lane_position[slot])
    if home < 0:
        return []
    found = []
    reach = horizon + float(states.length.max())
    # Distance from the vehicle to where each lane begins, counted in the direction of the search.
    first = -s if ahead else s - float(roads.length[home])
    for lane, begin in _lanes_along(roads, home, first, reach, ahead=ahead):
        whole = float(roads.length[lane])
        for other in others[states.lane[others] == lane].tolist():
            place = float(states.lane_position[other])
            distance = begin + (place if ahead else whole - place)
            if 0.0 < distance <= reach:
                found.append((other, distance))
    return found


def _lanes_along(
    roads: LaneGraph, home: int, begin: float, reach: float, *, ahead: bool
) -> Iterator[tuple[int, float]]:
    """Yield the lanes ahead of a lane (or behind it) within reach, with the least distances to them [m]."""
    onward = roads.successors if ahead else roads.predecessors
    open_lanes, seen = [(begin, home)], set[int]()
    while open_lanes:
        begin, lane = heapq.heappop(open_lanes)
        if lane in seen:
            continue
        seen.add(lane)
        yield lane, begin
        end = begin + float(roads.length[lane])
        if end <= reach:
            for following in onward(lane).tolist():
                heapq.heappush(open_lanes, (end, following))
