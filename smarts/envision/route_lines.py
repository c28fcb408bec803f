"""Computes the poses and lines of missions and flows on the map."""

from __future__ import annotations

import numpy as np

from smarts.arrays import Floats
from smarts.roads.corridors import Corridor, route_corridor
from smarts.roads.lane_graph import LaneGraph, LaneKind
from smarts.roads.routes import shortest_route
from smarts.sstudio import types as t
from smarts.sstudio.sstypes.constants import named_offset

Place = tuple[str, int, float | str]

ANY_VEHICLE = frozenset({LaneKind.CAR, LaneKind.BUS})
CAR_LENGTH = 5.0
"""Length of a car [m]; the offset of a start is that of its front bumper."""
LANE_CHANGE = 25.0
"""Length of a lane change in a picture [m]."""


def start_pose(roads: LaneGraph, mission: t.AnyMission) -> tuple[float, float, float] | None:
    """Return x, y [m], heading [rad] of a car's centre at a mission's start, or None for a random route."""
    if isinstance(mission, t.EndlessMission):
        return pose_on_map(roads, mission.begin, behind=CAR_LENGTH / 2)
    if isinstance(mission.route, t.Route):
        return pose_on_map(roads, mission.route.begin, behind=CAR_LENGTH / 2)
    return None


def route_line(roads: LaneGraph, route: t.Route) -> Floats:
    """Return the line along connected lanes from a route's beginning to its end [m], shape (P, 2).

    Lane changes are half-way along the road.
    """
    begin, end = route.begin, route.end
    (first, s0), (last, s1) = place_on_map(roads, begin), place_on_map(roads, end)
    lap = begin[0] == end[0] and s1 <= s0
    edges = shortest_route(roads, begin[0], end[0], route.via, lap=lap, kinds=ANY_VEHICLE)
    legs = _lanes_along(roads, route_corridor(roads, edges, ANY_VEHICLE), first, last)
    parts = []
    for number, lanes in enumerate(legs):
        low = s0 if number == 0 else 0.0
        high = s1 if number == len(legs) - 1 else np.inf
        parts += _leg(roads, lanes, low, high)
    return np.concatenate(parts)


def _lanes_along(roads: LaneGraph, corridor: Corridor, first: int, last: int) -> list[list[int]]:
    """Return the lanes on each road and in each junction of a corridor: two where the lane changes."""
    row = int(np.flatnonzero(corridor.lane == first)[0])
    legs = [[first]]
    while True:
        onward = _onward(corridor, row)
        if not onward:
            of_road = np.flatnonzero(corridor.group == corridor.group[row]).tolist()
            beside = [other for other in of_road if _onward(corridor, other)]
            if not beside:
                break
            row = min(beside, key=lambda other: abs(other - row))
            legs[-1].append(int(corridor.lane[row]))
            onward = _onward(corridor, row)
        goal = roads.lane_index[last]
        row = min(onward, key=lambda other: abs(roads.lane_index[corridor.lane[other]] - goal))
        legs.append([int(corridor.lane[row])])
    if legs[-1][-1] != last:
        legs[-1].append(last)
    return legs


def _onward(corridor: Corridor, row: int) -> list[int]:
    return corridor.onward[corridor.onward_start[row] : corridor.onward_start[row + 1]].tolist()


def _leg(roads: LaneGraph, lanes: list[int], low: float, high: float) -> list[Floats]:
    """Return the line from arc length `low` to `high` [m] on one road, from its first lane to its last."""
    before, after = lanes[0], lanes[-1]
    if before == after:
        return [_between(roads, before, low, high)]
    ends = (low, min(high, float(roads.length[after])))
    reach = min(LANE_CHANGE, abs(ends[1] - ends[0])) / 2
    middle = sum(ends) / 2
    return [_between(roads, before, low, middle - reach), _between(roads, after, middle + reach, high)]


def _between(roads: LaneGraph, lane: int, s0: float, s1: float) -> Floats:
    rows = slice(roads.point_start[lane], roads.point_start[lane + 1])
    inside = (roads.point_s[rows] > s0) & (roads.point_s[rows] < s1)
    ends = [roads.pose_at(lane, min(s, float(roads.length[lane])))[:2] for s in (s0, s1)]
    return np.concatenate([[ends[0]], roads.point_xy[rows][inside], [ends[1]]])


def pose_on_map(roads: LaneGraph, place: Place, behind: float = 0.0) -> tuple[float, float, float]:
    """Return x, y [m], heading [rad] of a scenario's place, `behind` metres before it."""
    lane, s = place_on_map(roads, place)
    return roads.pose_at(lane, s - behind)


def place_on_map(roads: LaneGraph, place: Place) -> tuple[int, float]:
    """Return the lane and arc length [m] of a scenario's position; a random offset becomes the middle."""
    edge, index, offset = place
    lane = roads.lane_number(edge, index)
    if not isinstance(offset, str):
        return lane, roads.arc_length(lane, float(offset))
    return lane, named_offset(offset, 0.0, float(roads.length[lane]), lambda low, high: (low + high) / 2)
