"""Paths along the lanes of routes, stored as one polyline so that one call returns many vehicles' poses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Floats, Ints
from smarts.geometry.frames import wrap_angle
from smarts.roads.atlas import ROAD_LANES
from smarts.roads.lane_graph import LaneGraph

NEAR, ALIGNED = 3.0, np.pi / 4
"""Maximum distance [m] and heading difference [rad] of a vehicle that is on a path."""
GRID = 2.0**-20
"""Stations are multiples of this [m], so that their sums with the paths' starts are exact."""


class LanePaths:
    """P paths, each along the lanes of a route.

    Args:
        maps: The maps, by their number in the atlas.

    Attributes:
        length: Length of each path [m], shape (P,).
        speed: The lowest speed limit on each path [m/s], shape (P,).
        period: After how long each path begins again [m], infinite for one that ends, shape (P,).
        edges: Edge numbers of each path's route.
    """

    def __init__(self, maps: Sequence[LaneGraph]) -> None:
        self.length, self.speed, self.period = np.zeros(0), np.zeros(0), np.zeros(0)
        self.edges: list[tuple[int, ...]] = []
        self._maps = tuple(maps)
        self._numbers: dict[tuple[int, tuple[int, ...], bool], int] = {}
        self._start = np.zeros(0)
        self._points = np.zeros((5, 0))
        """Rows: station along all paths in succession [m], x, y [m], unwrapped heading [rad], height [m]."""
        self._rows: list[NDArray[np.intp]] = []
        """Columns of `_points` of each path."""

    def add(self, map_number: int, edges: tuple[int, ...], *, repeats: bool = False) -> int:
        """Return the number of the path along a route; add the path if it is new.

        Args:
            map_number: The map's.
            edges: Edge numbers of the route.
            repeats: Whether the route begins again at its end.
        """
        key = map_number, edges, repeats
        if key in self._numbers:
            return self._numbers[key]
        graph = self._maps[map_number]
        if repeats:
            edges = (*edges, edges[0])
        lanes = _lanes_along(graph, edges)
        xy = np.concatenate([graph.centreline(lane) for lane in lanes])
        rows = [np.arange(graph.point_start[lane], graph.point_start[lane + 1]) for lane in lanes]
        heading = np.unwrap(graph.point_heading[np.concatenate(rows)])
        height = graph.point_z[np.concatenate(rows)]
        s = _on_grid(np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(xy, axis=0).T))]))
        # Leave a gap of 1 m or more, so that a station identifies the path.
        before = self._points.shape[1]
        start = np.ceil(self._points[0, -1]) + 1.0 if before else 0.0
        self._rows.append(before + np.arange(len(s)))
        self._points = np.concatenate([self._points, [start + s, *xy.T, heading, height]], axis=1)
        self._start, self.length = np.append(self._start, start), np.append(self.length, s[-1])
        self.speed = np.append(self.speed, graph.speed_limit[lanes].min())
        self.period = np.append(self.period, s[-len(rows[-1])] if repeats else np.inf)
        self._numbers[key] = len(self.edges)
        self.edges.append(edges)
        return self._numbers[key]

    def wrapped(self, path: Ints, s: Floats) -> Floats:
        """Return distances along paths [m], those beyond the period of a repeated one from its begin."""
        return np.fmod(s, self.period[path])

    def poses(self, path: Ints, s: Floats, t: Floats) -> Floats:
        """Return x, y [m], heading [rad] at `s` along and `t` to the left of paths [m], shape (N, 3)."""
        if not len(path):
            return np.zeros((0, 3))
        station = self._start[path] + np.clip(_on_grid(s), 0.0, self.length[path])
        x, y, heading = (np.interp(station, self._points[0], column) for column in self._points[1:4])
        return np.column_stack([x - t * np.sin(heading), y + t * np.cos(heading), wrap_angle(heading)])

    def heights(self, path: Ints, s: Floats) -> Floats:
        """Return the heights at `s` along paths [m], shape (N,)."""
        station = self._start[path] + np.clip(_on_grid(s), 0.0, self.length[path])
        return np.interp(station, self._points[0], self._points[4]) if len(path) else np.zeros(0)

    def nearest(self, paths: Sequence[int], x: float, y: float, heading: float) -> tuple[int, float, float]:
        """Return path, s and t [m] of a pose on the nearest of `paths`; -1, 0, 0 if none is near and aligned.

        Of equally near paths, it is the first one.
        """
        if not len(paths):
            return -1, 0.0, 0.0
        rows = np.concatenate([self._rows[path] for path in paths])
        station, xs, ys, along = self._points[:4, rows]
        dx, dy = x - xs, y - ys
        distance = np.hypot(dx, dy)
        distance[np.abs(wrap_angle(along - heading)) >= ALIGNED] = np.inf
        place = int(distance.argmin())
        if distance[place] > NEAR:
            return -1, 0.0, 0.0
        path = int(np.repeat(paths, [len(self._rows[path]) for path in paths])[place])
        dx, dy, cos, sin = dx[place], dy[place], np.cos(along[place]), np.sin(along[place])
        s = station[place] - self._start[path] + dx * cos + dy * sin
        return path, float(s), float(dy * cos - dx * sin)


def _on_grid(s: Floats) -> Floats:
    return np.rint(s / GRID) * GRID


def _lanes_along(graph: LaneGraph, edges: tuple[int, ...]) -> list[int]:
    """Return lanes that follow a route; where consecutive lanes do not connect, the path jumps sideways."""
    lanes = [lane for lane in graph.edge_lanes(edges[-1]) if graph.kind[lane] in ROAD_LANES][:1]
    for edge, following in zip(edges[-2::-1], edges[:0:-1], strict=True):
        options = [
            option
            for lane in graph.edge_lanes(edge)
            for option in _connections(graph, lane, following)
            if all(graph.kind[each] in ROAD_LANES for each in option)
        ]
        ahead = lanes[0]
        lanes = min(options, key=lambda option: abs(option[-1] - ahead))[:-1] + lanes
    return lanes


def _connections(graph: LaneGraph, lane: int, edge: int) -> Iterator[list[int]]:
    """Yield the lanes from a lane through the junction ahead to each lane of an edge."""
    for following in graph.successors(lane).tolist():
        if graph.lane_edge[following] == edge:
            yield [lane, following]
        elif graph.is_internal[following]:
            yield from ([lane, *rest] for rest in _connections(graph, following, edge))
