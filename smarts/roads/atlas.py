"""The road atlas: several maps at once, so that one call answers for vehicles of many simulations."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from smarts.roads import kernels
from smarts.roads.arrays import RouteTable
from smarts.roads.corridors import free_corridor, route_corridor
from smarts.roads.lane_graph import LaneGraph, LaneKind
from smarts.roads.packing import pack_roads, pack_routes
from smarts.roads.waypoints import WaypointPaths, write_waypoints

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Bools = NDArray[np.bool_]

ROAD_LANES = frozenset({LaneKind.CAR, LaneKind.BUS})
"""The lanes that are road to a motor vehicle."""


@dataclass(frozen=True, eq=False)
class LanePositions:
    """Where E poses are on their maps."""

    lane: Ints
    """Lane within the map, -1 where there is none, shape (E,)."""
    s: Floats
    """Arc length of the foot on the centreline [m], shape (E,)."""
    t: Floats
    """Signed lateral error: offset from the centreline, positive to the left [m], shape (E,)."""
    distance: Floats
    """From the centreline [m]: |t|, or more behind an end of the lane, shape (E,)."""

    @classmethod
    def allocate(cls, count: int) -> LanePositions:
        """Return buffers for `count` poses."""
        return cls(np.empty(count, np.int32), np.empty(count), np.empty(count), np.empty(count))


class RoadAtlas:
    """Several road maps. A pose belongs to the map that its map number names.

    All methods take and return arrays over E poses, write into the buffers of `out` where given, and take
    lanes by their number within the pose's own map. Routes are numbers in a `RouteTable` of this atlas.
    """

    def __init__(self, graphs: Sequence[LaneGraph]) -> None:
        self.graphs = tuple(graphs)
        self.roads = pack_roads(self.graphs)
        self.no_routes = self.route_table(())

    def route_table(
        self, routes: Iterable[tuple[int, Sequence[str]]], kinds: frozenset[LaneKind] = ROAD_LANES
    ) -> RouteTable:
        """Return a table of routes, each a map number and the ids of its road edges; route i is the i-th.

        Raises:
            MapError: A route has an unknown edge or a gap.
        """
        free = [(world, free_corridor(graph, kinds)) for world, graph in enumerate(self.graphs)]
        own = [(world, route_corridor(self.graphs[world], tuple(route), kinds)) for world, route in routes]
        return pack_routes(free, own, self.roads.lane_base)

    def locate(
        self,
        maps: Ints,
        position: Floats,
        heading: Floats | None = None,
        routes: Ints | None = None,
        table: RouteTable | None = None,
        *,
        kinds: Collection[LaneKind] = ROAD_LANES,
        out: LanePositions | None = None,
    ) -> LanePositions:
        """Return the lane that each pose is on, else the nearest one; `kernels.locate` gives the rule.

        Args:
            maps: Map numbers, shape (E,).
            position: [m], shape (E, 2).
            heading: [rad], shape (E,): of overlapping lanes, prefer those that fit it.
            routes: Route numbers or -1, shape (E,): of overlapping lanes, prefer those of the route.
            table: The routes' table; needed with `routes`.
            kinds: The lanes that count.
            out: Buffers to write into.
        """
        if routes is not None and table is None:
            raise TypeError("locate() needs the table that the routes are numbers of")
        count = len(maps)
        out = LanePositions.allocate(count) if out is None else out
        kernels.locate(
            self.roads,
            self.no_routes if table is None else table,
            _ints(maps),
            _floats(position),
            np.full(count, np.nan) if heading is None else _floats(heading),
            np.full(count, -1, np.int32) if routes is None else _ints(routes),
            _mask(kinds),
            out.lane,
            out.s,
            out.t,
            out.distance,
        )
        return out

    def project(self, maps: Ints, lane: Ints, position: Floats) -> tuple[Floats, Floats]:
        """Return s and t [m] of positions with respect to given lanes, NaN where the lane is -1."""
        s, t = np.empty(len(maps)), np.empty(len(maps))
        kernels.project_on_lanes(self.roads, _ints(maps), _ints(lane), _floats(position), s, t)
        return s, t

    def poses(self, maps: Ints, lane: Ints, s: Floats, t: Floats) -> tuple[Floats, Floats]:
        """Return positions [m], shape (E, 2), and headings [rad] at given places on lanes."""
        position, heading = np.empty((len(maps), 2)), np.empty(len(maps))
        kernels.poses_at(self.roads, _ints(maps), _ints(lane), _floats(s), _floats(t), position, heading)
        return position, heading

    def on_road(
        self,
        maps: Ints,
        position: Floats,
        *,
        kinds: Collection[LaneKind] = ROAD_LANES,
        junctions: bool = True,
    ) -> Bools:
        """Return whether points lie on a lane of these kinds, or, if wanted, inside a junction's outline."""
        result = np.empty(len(maps), np.bool_)
        kernels.on_road(self.roads, _ints(maps), _floats(position), _mask(kinds), junctions, result)
        return result

    def corners_on_road(
        self,
        maps: Ints,
        position: Floats,
        heading: Floats,
        length: Floats,
        width: Floats,
        *,
        kinds: Collection[LaneKind] = ROAD_LANES,
        junctions: bool = True,
    ) -> NDArray[np.int8]:
        """Return how many corners of each vehicle's footprint are on the road, 0 to 4; see `on_road`."""
        result = np.empty(len(maps), np.int8)
        kernels.corners_on_road(
            self.roads,
            _ints(maps),
            _floats(position),
            _floats(heading),
            _floats(length),
            _floats(width),
            _mask(kinds),
            junctions,
            result,
        )
        return result

    def route_distances(
        self, table: RouteTable, maps: Ints, routes: Ints, lane: Ints, s: Floats, hint: Floats | None = None
    ) -> tuple[Floats, Floats]:
        """Return the distance gone along each route and what remains to its end [m], NaN off the route.

        Args:
            table: The routes.
            maps: Map numbers, shape (E,).
            routes: Route numbers or -1, shape (E,).
            lane: Lanes within the maps or -1, shape (E,).
            s: Arc lengths on the lanes [m], shape (E,).
            hint: The distance gone when last asked [m], NaN if never; settles which time it is where a route
                comes by the same lane twice. Without it, the first time.
        """
        count = len(maps)
        hint = np.full(count, np.nan) if hint is None else _floats(hint)
        done, remaining = np.empty(count), np.empty(count)
        kernels.route_distances(
            self.roads, table, _ints(maps), _ints(routes), _ints(lane), _floats(s), hint, done, remaining
        )
        return done, remaining

    def waypoints(
        self,
        table: RouteTable,
        maps: Ints,
        position: Floats,
        lane: Ints,
        routes: Ints,
        hint: Floats | None = None,
        *,
        paths: int = 8,
        lookahead: int = 32,
        spacing: float = 1.0,
        kinds: Collection[LaneKind] = ROAD_LANES,
        out: WaypointPaths | None = None,
    ) -> WaypointPaths:
        """Return the paths ahead of each vehicle; `WaypointPaths` says how they run, branch and end.

        Args:
            table: The routes.
            maps: Map numbers, shape (E,).
            position: [m], shape (E, 2).
            lane: Lanes within the maps that the vehicles are on, as from `locate`, shape (E,).
            routes: Route numbers or -1, shape (E,).
            hint: As in `route_distances`.
            paths: K, the most paths of a vehicle.
            lookahead: W, the most waypoints of a path, the one beside the vehicle included.
            spacing: Between waypoints [m].
            kinds: The lanes beside the vehicle that have paths.
            out: Buffers to write into, whose shape then overrides `paths` and `lookahead`.
        """
        out = WaypointPaths.allocate(len(maps), paths, lookahead) if out is None else out
        hint = np.full(len(maps), np.nan) if hint is None else _floats(hint)
        write_waypoints(
            self.roads,
            table,
            _ints(maps),
            _floats(position),
            _ints(lane),
            _ints(routes),
            hint,
            _mask(kinds),
            spacing,
            out,
        )
        return out


def _ints(values: Ints) -> Ints:
    return _plain(values, np.int32)


def _floats(values: Floats) -> Floats:
    return _plain(values, np.float64)


def _plain(values: NDArray, dtype: type) -> NDArray:
    """Return contiguous, writable numbers: to numba any other kind of array is another kernel to compile."""
    array = np.ascontiguousarray(values, dtype)
    return array if array.flags.writeable else array.copy()


def _mask(kinds: Iterable[LaneKind]) -> int:
    return sum(1 << kind for kind in set(kinds))
