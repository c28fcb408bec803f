"""Planned paths along lanes, and where two of them first contend for the same place.

A path begins at the begin of the lane that a vehicle is on, so the vehicle is its s into it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from smarts.roads.lane_graph import ConflictKind, LaneGraph

Ints = NDArray[np.int32]
Floats = NDArray[np.float64]

REACH = 200.0
"""How far paths go beyond the lane that they begin on [m]."""
STRIP = 2.0
"""Width of the strip that a vehicle covers [m]."""
MOST_LANES = 24
"""Lanes of a path at most."""

CROSS, MERGE, CHANGE = int(ConflictKind.CROSS), int(ConflictKind.MERGE), 2
"""How paths meet. CHANGE: side by side on a road, and one has to get into a lane that the other uses."""


@dataclass(frozen=True, eq=False)
class LanePath:
    """The lanes of a planned path, and how far into it each begins [m]."""

    lanes: tuple[int, ...]
    begins: tuple[float, ...]
    targets: tuple[int, ...]
    """Lane of the same road into which each has to be left, itself where it leads on."""


@dataclass(frozen=True)
class Conflict:
    """Where two paths contend: from and to along the first and the second [m].

    The name stays while vehicles change lanes on the way: two that meet in a junction meet there once, on
    whatever lanes.
    """

    kind: int
    begin: float
    end: float
    other_begin: float
    other_end: float
    name: int


Plan = tuple[int, tuple[int, ...], int]
"""Lane that it begins on, edges of the route, lane of the goal (-1 for none)."""


class PathBook:
    """The paths of one map, made when they are asked for and kept.

    Args:
        graph: The map.
    """

    def __init__(self, graph: LaneGraph) -> None:
        self.graph = graph
        self.paths: list[LanePath] = []
        self._numbers: dict[Plan, int] = {}
        self._sections: dict[tuple[int, int], Conflict | None] = {}

    def number(self, plan: Plan) -> int:
        """Return the number of a path in `paths`."""
        if plan not in self._numbers:
            self._numbers[plan] = len(self.paths)
            self.paths.append(_path(self.graph, *plan))
        return self._numbers[plan]

    def section(self, path: int, other: int) -> Conflict | None:
        """Return where two paths first contend, None where they do not or one follows the other before."""
        if (path, other) not in self._sections:
            self._sections[path, other] = _section(self.graph, self.paths[path], self.paths[other])
        return self._sections[path, other]


@lru_cache(maxsize=16)
def path_book(map_file: Path) -> PathBook:
    """Return the (remembered) paths of a saved map.

    Raises:
        MapError: There is no such map.
    """
    return PathBook(LaneGraph.load(map_file))


def _path(graph: LaneGraph, lane: int, route: tuple[int, ...], goal_lane: int) -> LanePath:
    lanes, begins, targets = [], [], []
    begin, current = 0.0, lane
    place = _place_on_route(graph, lane, route)
    while current >= 0 and len(lanes) < MOST_LANES and begin < REACH + graph.length[lane]:
        target, following = _onward(graph, current, route, place, goal_lane)
        lanes.append(current)
        begins.append(begin)
        targets.append(target)
        begin += float(graph.length[current])
        current = following
        if following >= 0 and place + 1 < len(route) and graph.lane_edge[following] == route[place + 1]:
            place += 1
    return LanePath(tuple(lanes), tuple(begins), tuple(targets))


def _place_on_route(graph: LaneGraph, lane: int, route: tuple[int, ...]) -> int:
    """Return the place of a lane's edge on the route; inside a junction, of the edge before; else -1."""
    edge = int(graph.lane_edge[lane])
    if edge in route:
        return route.index(edge)
    # Inside a junction: the way out leads to the edge after.
    for _ in range(4):
        following = graph.successors(lane)
        if not len(following) or not graph.is_internal[lane]:
            return len(route)
        lane = int(following[0])
        if int(graph.lane_edge[lane]) in route:
            return route.index(int(graph.lane_edge[lane])) - 1
    return len(route)


def _onward(
    graph: LaneGraph, lane: int, route: tuple[int, ...], place: int, goal_lane: int
) -> tuple[int, int]:
    """Return the lane that one has to be on at the end of a lane's road, and the lane after it."""
    if graph.is_internal[lane] or not 0 <= place < len(route):
        following = graph.successors(lane)
        return lane, int(following[0]) if len(following) == 1 else -1
    edge = int(graph.lane_edge[lane])
    if place + 1 >= len(route):
        is_there = goal_lane >= 0 and graph.lane_edge[goal_lane] == edge
        return (goal_lane if is_there else lane), -1
    lanes = sorted(graph.edge_lanes(edge), key=lambda each: (abs(each - lane), each))
    ways = ((each, _way(graph, each, route, place, goal_lane)) for each in lanes)
    return next(((each, way) for each, way in ways if way >= 0), (lane, -1))


def _way(graph: LaneGraph, lane: int, route: tuple[int, ...], place: int, goal_lane: int) -> int:
    """Return the successor by which a lane leads to the route's next edge, best to the goal's lane; or -1."""
    best, best_distance = -1, np.inf
    for successor in graph.successors(lane).tolist():
        end = successor
        while graph.is_internal[end] and len(graph.successors(end)):
            end = int(graph.successors(end)[0])
        if graph.lane_edge[end] != route[place + 1]:
            continue
        is_last = goal_lane >= 0 and graph.lane_edge[goal_lane] == graph.lane_edge[end]
        wanted = graph.lane_index[goal_lane] if is_last else graph.lane_index[lane]
        distance = abs(int(graph.lane_index[end]) - int(wanted))
        if distance < best_distance:
            best, best_distance = successor, distance
    return best


def _section(graph: LaneGraph, path: LanePath, other: LanePath) -> Conflict | None:
    places = {lane: number for number, lane in reversed([*enumerate(other.lanes)])}
    edges = {int(graph.lane_edge[lane]): number for lane, number in reversed([*places.items()])}
    for number, lane in enumerate(path.lanes):
        if lane in places:
            return _merge(graph, path, number, other, places[lane])
        found = _conflict(graph, path, number, other, places)
        beside = edges.get(int(graph.lane_edge[lane]))
        if found is None and beside is not None:
            found = _change(graph, path, number, other, beside)
        if found is not None:
            return found
    return None


def _merge(graph: LaneGraph, path: LanePath, number: int, other: LanePath, place: int) -> Conflict | None:
    """Return where both come into a lane; a vehicle that is in it already is followed, not met."""
    if number == 0 or place == 0:
        return None
    begin, other_begin = path.begins[number], other.begins[place]
    return Conflict(MERGE, begin, begin, other_begin, other_begin, _name(graph, path.lanes[number - 1]))


def _conflict(
    graph: LaneGraph, path: LanePath, number: int, other: LanePath, places: dict[int, int]
) -> Conflict | None:
    """Return the first section of a junction lane that the other's path meets."""
    lane, begin = path.lanes[number], path.begins[number]
    rows = slice(int(graph.conflict_start[lane]), int(graph.conflict_start[lane + 1]))
    best = None
    kinds = graph.conflict_kind[rows].tolist()
    for partner, kind in zip(graph.conflict_lane[rows].tolist(), kinds, strict=True):
        found = _overlap(graph, lane, partner) if partner in places else None
        if found is None or (best is not None and found[0] + begin >= best.begin):
            continue
        other_begin = other.begins[places[partner]]
        along, across = (found[0] + begin, found[1] + begin), (found[2] + other_begin, found[3] + other_begin)
        best = Conflict(kind, *along, *across, _name(graph, lane))
    return best


def _overlap(graph: LaneGraph, lane: int, other: int) -> tuple[float, float, float, float] | None:
    """Return from where to where the strips that vehicles cover on two lanes overlap, along each [m].

    The map's own conflicts are those of whole lanes, which may overlap where their vehicles pass each other
    with room to spare, as in opposite left turns: there is None.
    """
    points, stations = _dense(graph, lane)
    other_points, other_stations = _dense(graph, other)
    gap = np.hypot(*(points[:, None] - other_points[None]).transpose(2, 0, 1))
    along = stations[gap.min(axis=1) < STRIP]
    across = other_stations[gap.min(axis=0) < STRIP]
    if not len(along):
        return None
    return float(along[0]), float(along[-1]), float(across[0]), float(across[-1])


def _dense(graph: LaneGraph, lane: int) -> tuple[Floats, Floats]:
    """Return points of a lane's centreline every 0.25 m, and their arc lengths [m]."""
    rows = slice(int(graph.point_start[lane]), int(graph.point_start[lane + 1]))
    stations = np.linspace(0.0, graph.length[lane], max(2, math.ceil(graph.length[lane] / 0.25) + 1))
    known = graph.point_s[rows]
    x, y = (np.interp(stations, known, graph.point_xy[rows, axis]) for axis in (0, 1))
    return np.stack([x, y], axis=-1), stations


def _change(graph: LaneGraph, path: LanePath, number: int, other: LanePath, place: int) -> Conflict | None:
    """Return the road on which the two are side by side, if one sweeps lanes that the other uses."""
    swept = sorted((path.lanes[number], path.targets[number]))
    other_swept = sorted((other.lanes[place], other.targets[place]))
    if swept[0] == swept[1] and other_swept[0] == other_swept[1]:
        return None
    if swept[1] < other_swept[0] or other_swept[1] < swept[0]:
        return None
    length = float(graph.length[path.lanes[number]])
    begin, other_begin = path.begins[number], other.begins[place]
    name = _name(graph, path.lanes[number])
    return Conflict(CHANGE, begin, begin + length, other_begin, other_begin + length, name)


def _name(graph: LaneGraph, lane: int) -> int:
    """Return the number of a lane's junction, and for a road below 0 that of its edge."""
    junction = int(graph.lane_junction[lane])
    return junction if junction >= 0 else -1 - int(graph.lane_edge[lane])
