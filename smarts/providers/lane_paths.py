"""Paths along the lanes of routes, of several maps, as one polyline: poses of many vehicles in one call."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Floats, Ints
from smarts.errors import TrafficError
from smarts.geometry.frames import wrap_angle
from smarts.roads.atlas import ROAD_LANES
from smarts.roads.lane_graph import LaneGraph

NEAR, ALIGNED = 3.0, np.pi / 4
"""How far a vehicle may be from a path [m], and turned away from it [rad], to be taken for being on it."""
GRID = 2.0**-20
"""Of stations [m]: their sums with the begins of paths are exact, whichever paths have been added before."""


class LanePaths:
    """P paths, each along the lanes of a route.

    Args:
        maps: The maps by their number in the atlas.

    Attributes:
        length: [m], shape (P,).
        speed: The lowest limit on each path [m/s], shape (P,).
        edges: The edges of each path's route, by number.
    """

    def __init__(self, maps: Sequence[LaneGraph]) -> None:
        self.length, self.speed = np.zeros(0), np.zeros(0)
        self.edges: list[tuple[int, ...]] = []
        self._maps = tuple(maps)
        self._numbers: dict[tuple[int, tuple[int, ...]], int] = {}
        self._start = np.zeros(0)
        self._points = np.zeros((4, 0))
        """Station along all paths one after another [m], x, y [m], unwrapped heading [rad]."""
        self._rows: list[NDArray[np.intp]] = []
        """Of each path's points."""

    def add(self, map_number: int, edges: tuple[int, ...]) -> int:
        """Return the number of the path along a route, a new one if need be.

        Raises:
            TrafficError: An edge of the route does not lead into the next.
        """
        if (map_number, edges) in self._numbers:
            return self._numbers[map_number, edges]
        graph = self._maps[map_number]
        lanes = _lanes_along(graph, edges)
        xy = np.concatenate([graph.centreline(lane) for lane in lanes])
        rows = [np.arange(graph.point_start[lane], graph.point_start[lane + 1]) for lane in lanes]
        heading = np.unwrap(graph.point_heading[np.concatenate(rows)])
        s = _on_grid(np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(xy, axis=0).T))]))
        # A gap of a metre, so that stations tell paths apart.
        before = self._points.shape[1]
        start = np.ceil(self._points[0, -1]) + 1.0 if before else 0.0
        self._rows.append(before + np.arange(len(s)))
        self._points = np.concatenate([self._points, [start + s, *xy.T, heading]], axis=1)
        self._start, self.length = np.append(self._start, start), np.append(self.length, s[-1])
        self.speed = np.append(self.speed, graph.speed_limit[lanes].min())
        self._numbers[map_number, edges] = len(self.edges)
        self.edges.append(edges)
        return self._numbers[map_number, edges]

    def poses(self, path: Ints, s: Floats, t: Floats) -> Floats:
        """Return x, y [m], heading [rad] of places on paths, shape (N, 3): `s` along, `t` to the left [m]."""
        if not len(path):
            return np.zeros((0, 3))
        station = self._start[path] + np.clip(_on_grid(s), 0.0, self.length[path])
        x, y, heading = (np.interp(station, self._points[0], column) for column in self._points[1:])
        return np.column_stack([x - t * np.sin(heading), y + t * np.cos(heading), wrap_angle(heading)])

    def nearest(self, paths: Sequence[int], x: float, y: float, heading: float) -> tuple[int, float, float]:
        """Return path, s and t [m] of a pose on one of some paths; path -1 if none is `NEAR` and `ALIGNED`.

        Of paths that are equally near it is the first one in `paths`.
        """
        if not len(paths):
            return -1, 0.0, 0.0
        rows = np.concatenate([self._rows[path] for path in paths])
        station, xs, ys, along = self._points[:, rows]
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
    """Return lanes that follow a route; where they do not join, the vehicle has to move over."""
    lanes = [lane for lane in graph.edge_lanes(edges[-1]) if graph.kind[lane] in ROAD_LANES][:1]
    for edge, following in zip(edges[-2::-1], edges[:0:-1], strict=True):
        ways = [way for lane in graph.edge_lanes(edge) for way in _ways(graph, lane, following)]
        if not ways or not lanes:
            names = f"{graph.edge_ids[edge]!r} to {graph.edge_ids[following]!r}"
            raise TrafficError(f"no lane leads from edge {names}", place="a route of the traffic")
        ahead = lanes[0]
        lanes = min(ways, key=lambda way: abs(way[-1] - ahead))[:-1] + lanes
    return lanes


def _ways(graph: LaneGraph, lane: int, edge: int) -> Iterator[list[int]]:
    """Yield the lanes from a lane through the junction ahead, up to one of an edge."""
    for following in graph.successors(lane).tolist():
        if graph.lane_edge[following] == edge:
            yield [lane, following]
        elif graph.is_internal[following]:
            yield from ([lane, *way] for way in _ways(graph, following, edge))
