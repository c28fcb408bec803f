"""Where missions and flows go, as lines on the map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from smarts.roads.corridors import Corridor, route_corridor
from smarts.roads.lane_graph import LaneGraph, LaneKind
from smarts.roads.routes import shortest_route
from smarts.sstudio import types as t

Floats = NDArray[np.float64]
Place = tuple[str, int, float | str]

ANY_VEHICLE = frozenset({LaneKind.CAR, LaneKind.BUS})


def start_pose(roads: LaneGraph, mission: t.AnyMission) -> tuple[float, float, float] | None:
    """Return x, y [m], heading [rad] of a mission's start; None if it is drawn anew in every episode."""
    if isinstance(mission, t.EndlessMission):
        return _pose(roads, mission.begin)
    return _pose(roads, mission.route.begin) if isinstance(mission.route, t.Route) else None


def goal_pose(roads: LaneGraph, mission: t.AnyMission) -> tuple[float, float, float] | None:
    """Return x, y [m], heading [rad] of a mission's goal; None if there is none or a random one."""
    if isinstance(mission, t.EndlessMission) or not isinstance(mission.route, t.Route):
        return None
    return _pose(roads, mission.route.end)


def route_line(roads: LaneGraph, route: t.Route) -> Floats:
    """Return a line from a route's begin to its end along lanes that connect, shape (., 2).

    Lanes are changed where the next junction asks for it; the line then jumps from lane to lane.
    """
    begin, end = route.begin, route.end
    first, last = roads.lane_number(begin[0], begin[1]), roads.lane_number(end[0], end[1])
    s0, s1 = _offset(roads, first, begin[2]), _offset(roads, last, end[2])
    lap = begin[0] == end[0] and s1 <= s0
    edges = shortest_route(roads, begin[0], end[0], route.via, lap=lap, kinds=ANY_VEHICLE)
    lanes = _lanes_along(roads, route_corridor(roads, edges, ANY_VEHICLE), first, last)
    parts = [roads.centreline(lane) for lane in lanes]
    if len(lanes) == 1:
        parts[0] = _between(roads, first, s0, s1)
    else:
        parts[0] = _between(roads, lanes[0], s0, np.inf)
        parts[-1] = _between(roads, lanes[-1], 0.0, s1)
    return np.concatenate(parts)


def _lanes_along(roads: LaneGraph, corridor: Corridor, first: int, last: int) -> list[int]:
    """Return lanes from `first` to `last`, one or more for each group of the corridor."""
    row = int(np.flatnonzero(corridor.lane == first)[0])
    lanes = [first]
    while True:
        onward = corridor.onward[corridor.onward_start[row] : corridor.onward_start[row + 1]]
        if len(onward) == 0:
            beside = _rows_beside(corridor, row)
            if not beside:
                break
            row = min(beside, key=lambda other: abs(other - row))
        else:
            goal_index = roads.lane_index[last]
            row = min(onward.tolist(), key=lambda r: abs(roads.lane_index[corridor.lane[r]] - goal_index))
        lanes.append(int(corridor.lane[row]))
    if lanes[-1] != last:
        lanes.append(last)
    return lanes


def _rows_beside(corridor: Corridor, row: int) -> list[int]:
    """Return the rows of the same edge that lead onward."""
    same = np.flatnonzero(corridor.group == corridor.group[row])
    return [int(other) for other in same if corridor.onward_start[other] < corridor.onward_start[other + 1]]


def _between(roads: LaneGraph, lane: int, s0: float, s1: float) -> Floats:
    rows = slice(roads.point_start[lane], roads.point_start[lane + 1])
    inside = (roads.point_s[rows] > s0) & (roads.point_s[rows] < s1)
    ends = [roads.pose_at(lane, min(s, float(roads.length[lane])))[:2] for s in (s0, s1)]
    return np.concatenate([[ends[0]], roads.point_xy[rows][inside], [ends[1]]])


def _pose(roads: LaneGraph, place: Place) -> tuple[float, float, float]:
    lane = roads.lane_number(place[0], place[1])
    return roads.pose_at(lane, _offset(roads, lane, place[2]))


def _offset(roads: LaneGraph, lane: int, offset: float | str) -> float:
    """Return an offset in metres; a random one is drawn in the middle of the lane."""
    named = {"base": 0.0, "max": float(roads.length[lane]), "random": float(roads.length[lane]) / 2}
    return named[offset] if isinstance(offset, str) else float(offset)
