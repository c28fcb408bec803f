"""The road atlas: several maps at once, so that one call answers for vehicles of many simulations."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from smarts.arrays import Bools, Bytes, Floats, Ints
from smarts.errors import MapError
from smarts.geometry.binding import bind
from smarts.roads import footprints, kernels
from smarts.roads.arguments import FLOAT, INT, NOT_GIVEN, floats, ints, require_buffers, require_numbers
from smarts.roads.arrays import RouteTable
from smarts.roads.corridors import free_corridor, route_corridor
from smarts.roads.lane_graph import LaneGraph, LaneKind
from smarts.roads.packing import pack_roads, pack_routes
from smarts.roads.waypoints import WaypointPaths, write_waypoints

_BESIDE = 1.0
"""How far beyond a road's left edge to look for the road of the other direction [m]."""
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
    lanes by their number within the pose's own map. Routes are numbers in a `RouteTable` of this atlas. They
    raise `ValueError` for a map, lane or route that there is not, and for arrays of unequal length.

    Raises:
        ValueError: There is no map.
        MapError: A map has more lanes in one place than the kernels have room for.
    """

    def __init__(self, graphs: Sequence[LaneGraph]) -> None:
        self.graphs = tuple(graphs)
        if not self.graphs:
            raise ValueError("graphs is empty, but an atlas has at least one map")
        self.roads = pack_roads(self.graphs)
        self._bound: dict[tuple[Any, int], Callable[..., None]] = {}
        self.no_routes = self._latest_table = self.route_table(())
        self._find_twins()

    def route_table(
        self, routes: Iterable[tuple[int, Sequence[str]]], kinds: frozenset[LaneKind] = ROAD_LANES
    ) -> RouteTable:
        """Return a table of routes, each a map number and the ids of its road edges; route i is the i-th.

        Raises:
            MapError: A route has no edge, an unknown one, one without lanes of these kinds, or a gap.
            ValueError: There is no map of a route's number.
        """
        free = [(world, free_corridor(graph, kinds)) for world, graph in enumerate(self.graphs)]
        own = []
        for number, (world, route) in enumerate(routes):
            if not 0 <= world < len(self.graphs):
                raise ValueError(
                    f"route {number} is on map {world}, but maps go from 0 to {len(self.graphs) - 1}"
                )
            if not route:
                raise MapError(
                    "a route without edges",
                    place=f"route {number} of the table",
                    remedy="leave it out; whoever has no route has route number -1",
                )
            own.append((world, route_corridor(self.graphs[world], tuple(route), kinds)))
        return pack_routes(free, own, self.roads.lane_base)

    def _require_own(self, table: RouteTable) -> None:
        """Refuse another atlas's table: its lanes have other numbers, which may be beyond this one's."""
        if table is self._latest_table or table is self.no_routes:
            return
        own = table.free == len(self.graphs) and np.array_equal(
            table.start[: table.free + 1], self.roads.lane_base
        )
        if not own:
            raise ValueError("table is not of this atlas, but its route numbers are meant to be")
        self._latest_table = table

    def _kernel(self, function: Any, *table: RouteTable) -> Callable[..., None]:
        """Return a kernel with the roads bound, and a table of routes if one is given."""
        key = function, id(table[0]) if table else 0
        if key not in self._bound:
            # Of the latest table only. What is bound keeps it alive, so that no other has the same `id`.
            kept = 0, id(self.no_routes), key[1]
            self._bound = {other: call for other, call in self._bound.items() if other[1] in kept}
            self._bound[key] = bind(function, self.roads, *table)
        return self._bound[key]

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
        table = self.no_routes if table is None else table
        self._require_own(table)
        count = len(maps)
        maps = ints("maps", maps, count)
        position = floats("position", position, count, 2)
        heading = np.full(count, np.nan) if heading is None else floats("heading", heading, count)
        route = np.full(count, -1, np.int32) if routes is None else ints("routes", routes, count)
        require_numbers(maps, NOT_GIVEN, route, self.roads.lane_base, table)
        if out is None:
            out = LanePositions.allocate(count)
        else:
            buffers = (out.lane, out.s, out.t, out.distance)
            require_buffers(_POSITION_NAMES, buffers, _POSITION_TYPES, [(count,)] * 4)
        self._kernel(kernels.locate, table)(
            maps,
            position,
            heading,
            route,
            _mask(kinds),
            out.lane,
            out.s,
            out.t,
            out.distance,
        )
        return out

    def project(self, maps: Ints, lane: Ints, position: Floats) -> tuple[Floats, Floats]:
        """Return s and t [m] of positions with respect to given lanes, NaN where the lane is -1."""
        count = len(maps)
        maps, lane = self._lanes(maps, lane)
        s, t = np.empty(count), np.empty(count)
        self._kernel(kernels.project_on_lanes)(maps, lane, floats("position", position, count, 2), s, t)
        return s, t

    def poses(self, maps: Ints, lane: Ints, s: Floats, t: Floats) -> tuple[Floats, Floats]:
        """Return positions [m], shape (E, 2), and headings [rad] at given places on lanes."""
        count = len(maps)
        maps, lane = self._lanes(maps, lane)
        s, t = floats("s", s, count), floats("t", t, count)
        position, heading = np.empty((count, 2)), np.empty(count)
        self._kernel(kernels.poses_at)(maps, lane, s, t, position, heading)
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
        maps = self._maps(maps)
        position = floats("position", position, len(maps), 2)
        result = np.empty(len(maps), np.bool_)
        self._kernel(footprints.on_road)(maps, position, _mask(kinds), bool(junctions), result)
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
    ) -> Bytes:
        """Return how many corners of each vehicle's footprint are on the road, 0 to 4; see `on_road`."""
        maps = self._maps(maps)
        count = len(maps)
        result = np.empty(count, np.int8)
        self._kernel(footprints.corners_on_road)(
            maps,
            floats("position", position, count, 2),
            floats("heading", heading, count),
            floats("length", length, count),
            floats("width", width, count),
            _mask(kinds),
            bool(junctions),
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
        self._require_own(table)
        count = len(maps)
        maps, lane, routes = (
            ints("maps", maps, count),
            ints("lane", lane, count),
            ints("routes", routes, count),
        )
        require_numbers(maps, lane, routes, self.roads.lane_base, table)
        hint = np.full(count, np.nan) if hint is None else floats("hint", hint, count)
        s = floats("s", s, count)
        done, remaining = np.empty(count), np.empty(count)
        self._kernel(kernels.route_distances, table)(maps, routes, lane, s, hint, done, remaining)
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
            spacing: Between waypoints [m], above 0.
            kinds: The lanes beside the vehicle that have paths.
            out: Buffers to write into, whose shape then overrides `paths` and `lookahead`.
        """
        if not 0.0 < spacing < kernels.FARTHEST:
            raise ValueError(f"spacing is {spacing}, but waypoints lie ahead of each other: above 0 m")
        self._require_own(table)
        count = len(maps)
        maps, lane = ints("maps", maps, count), ints("lane", lane, count)
        position, routes = floats("position", position, count, 2), ints("routes", routes, count)
        hint = np.full(count, np.nan) if hint is None else floats("hint", hint, count)
        require_numbers(maps, lane, routes, self.roads.lane_base, table)
        out = _waypoint_buffers(out, count, paths, lookahead)
        mask, spacing = _mask(kinds), float(spacing)
        self._kernel(write_waypoints, table)(maps, position, lane, routes, hint, mask, spacing, out)
        return out

    def _find_twins(self) -> None:
        """Write `lane_twin`: look beyond each road's left edge for a lane of the other direction."""
        roads, counts = self.roads, [len(graph.lane_ids) for graph in self.graphs]
        maps = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
        lane = np.concatenate([np.arange(count, dtype=np.int32) for count in counts])
        length = np.concatenate([graph.length for graph in self.graphs])
        width = np.concatenate([graph.width for graph in self.graphs])
        position, heading = self.poses(maps, lane, length / 2, width / 2 + _BESIDE)
        found = self.locate(maps, position, heading + np.pi)
        s, _ = self.project(maps, found.lane, position)
        _, other_heading = self.poses(maps, found.lane, s, np.zeros(len(lane)))
        across = found.lane + roads.lane_base[maps]
        is_twin = (
            np.concatenate([(graph.left < 0) & ~graph.is_internal for graph in self.graphs])
            & (np.cos(other_heading - heading) < 0.0)
            & (found.distance <= width[across] / 2)
            & ~roads.lane_inside[across]
        )
        # All lanes of a road have the twin of its leftmost one.
        of_edge = np.full(roads.lane_edge.max() + 1, -1, np.int32)
        of_edge[roads.lane_edge[is_twin]] = across[is_twin]
        roads.lane_twin[:] = of_edge[roads.lane_edge]

    def _maps(self, maps: Ints) -> Ints:
        """Return map numbers that have been checked."""
        maps = ints("maps", maps, len(maps))
        require_numbers(maps, NOT_GIVEN, NOT_GIVEN, self.roads.lane_base, self.no_routes)
        return maps

    def _lanes(self, maps: Ints, lane: Ints) -> tuple[Ints, Ints]:
        """Return map and lane numbers that have been checked."""
        count = len(maps)
        maps, lane = ints("maps", maps, count), ints("lane", lane, count)
        require_numbers(maps, lane, NOT_GIVEN, self.roads.lane_base, self.no_routes)
        return maps, lane


def _waypoint_buffers(out: WaypointPaths | None, vehicles: int, paths: int, lookahead: int) -> WaypointPaths:
    """Return buffers for the paths of E vehicles: the given ones, checked, or new ones."""
    if out is None:
        for name, size in (("paths", paths), ("lookahead", lookahead)):
            if size < 1:
                raise ValueError(f"{name} is {size}, but at least 1 is needed")
        return WaypointPaths.allocate(vehicles, paths, lookahead)
    if out.heading.ndim != 3:
        raise ValueError(f"out.heading has shape {out.heading.shape}, but three axes are needed")
    each = (vehicles, *out.heading.shape[1:])
    shapes = [each[:1], each[:2], (*each, 2), each, each, each, each, each, each]
    require_buffers(out._fields, out, _PATH_TYPES, shapes)
    return out


_POSITION_NAMES = ("lane", "s", "t", "distance")
_POSITION_TYPES = [INT, FLOAT, FLOAT, FLOAT]
_PATH_TYPES = [INT, INT, FLOAT, FLOAT, FLOAT, FLOAT, INT, INT, FLOAT]
"""Of the buffers of `LanePositions` and `WaypointPaths`, in their order."""


def _mask(kinds: Iterable[LaneKind]) -> int:
    return _ROAD_MASK if kinds is ROAD_LANES else sum(1 << kind for kind in set(kinds))


_ROAD_MASK = sum(1 << kind for kind in ROAD_LANES)
