"""The road atlas: several maps at once, so that one call answers for vehicles of many simulations."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from smarts.geometry.grid import Grid, build_grid
from smarts.roads import kernels
from smarts.roads.corridors import Corridor, free_corridor, route_corridor
from smarts.roads.kernels import Roads, RouteTable
from smarts.roads.lane_graph import LaneGraph, LaneKind
from smarts.roads.waypoints import WaypointPaths, write_waypoints

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Bools = NDArray[np.bool_]

ROAD_LANES = frozenset({LaneKind.CAR, LaneKind.BUS})
"""The lanes that are road to a motor vehicle."""

_CELL = 6.0
"""Side of a grid cell [m]; a lane's width or two, so that a cell lists few lanes."""
_MOST_CELLS = 2_000_000


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
        self.roads = _concatenate(self.graphs)
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
        return _table(free, own, self.roads.lane_base)

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
        count = len(maps)
        out = LanePositions.allocate(count) if out is None else out
        heading = np.full(count, np.nan) if heading is None else heading
        routes = np.full(count, -1, np.int32) if routes is None else routes
        table = self.no_routes if table is None else table
        kernels.locate(
            self.roads,
            table,
            maps,
            position,
            heading,
            routes,
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
        kernels.project_on_lanes(self.roads, maps, lane, position, s, t)
        return s, t

    def poses(self, maps: Ints, lane: Ints, s: Floats, t: Floats) -> tuple[Floats, Floats]:
        """Return positions [m], shape (E, 2), and headings [rad] at given places on lanes."""
        position, heading = np.empty((len(maps), 2)), np.empty(len(maps))
        kernels.poses_at(self.roads, maps, lane, s, t, position, heading)
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
        kernels.on_road(self.roads, maps, position, _mask(kinds), junctions, result)
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
            self.roads, maps, position, heading, length, width, _mask(kinds), junctions, result
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
        hint = np.full(count, np.nan) if hint is None else hint
        done, remaining = np.empty(count), np.empty(count)
        kernels.route_distances(self.roads, table, maps, routes, lane, s, hint, done, remaining)
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
        hint = np.full(len(maps), np.nan) if hint is None else hint
        write_waypoints(self.roads, table, maps, position, lane, routes, hint, _mask(kinds), spacing, out)
        return out


def _mask(kinds: Iterable[LaneKind]) -> int:
    return sum(1 << kind for kind in set(kinds))


def _concatenate(graphs: Sequence[LaneGraph]) -> Roads:
    grids = [_grid(graph) for graph in graphs]

    def joined(arrays: Iterable[ArrayLike]) -> NDArray:
        return np.concatenate([np.asarray(array) for array in arrays])

    def stacked(starts: Iterable[Ints]) -> Ints:
        """Join CSR starts: each map's numbers go on where those of the map before end."""
        counts = joined(np.diff(start) for start in starts)
        return np.concatenate(([0], np.cumsum(counts))).astype(np.int32)

    lane_base = _bases(len(graph.lane_ids) for graph in graphs)
    point_base = _bases(len(graph.point_s) for graph in graphs)
    junction_base = _bases(len(graph.junction_ids) for graph in graphs)
    shifts = np.stack((lane_base, point_base, point_base), axis=1)
    return Roads(
        lane_base=lane_base,
        lane_index=joined(graph.lane_index for graph in graphs),
        lane_width=joined(graph.width for graph in graphs),
        lane_speed=joined(graph.speed_limit for graph in graphs),
        lane_kind=joined(graph.kind for graph in graphs),
        lane_inside=joined(graph.is_internal for graph in graphs),
        point_start=stacked(graph.point_start for graph in graphs),
        point_xy=joined(graph.point_xy for graph in graphs),
        point_heading=joined(graph.point_heading for graph in graphs),
        point_s=joined(graph.point_s for graph in graphs),
        grid_origin=np.array([grid.origin for grid in grids]),
        grid_size=np.array([grid.size for grid in grids]),
        grid_shape=np.array([(grid.columns, grid.rows) for grid in grids], np.int32),
        cell_base=_bases(grid.columns * grid.rows for grid in grids),
        run_start=stacked(grid.run_start for grid in grids),
        run=joined(grid.run + shift for grid, shift in zip(grids, shifts, strict=False)).astype(np.int32),
        outline_start=stacked(grid.outline_start for grid in grids),
        outline=joined(g.outline + base for g, base in zip(grids, junction_base, strict=False)).astype(
            np.int32
        ),
        vertex_start=stacked(graph.junction_start for graph in graphs),
        vertex=joined(graph.junction_xy for graph in graphs),
    )


def _grid(graph: LaneGraph) -> Grid:
    extent = np.ptp(graph.point_xy, axis=0) + 2 * graph.width.max()
    size = max(_CELL, float(np.sqrt(extent[0] * extent[1] / _MOST_CELLS)))
    # The graph's own arrays are read-only, which would be another signature to compile.
    return build_grid(
        np.array(graph.point_start),
        np.array(graph.point_xy),
        # A lane inside a junction counts up to its whole width to either side, see `kernels.locate`.
        np.array(graph.width),
        np.array(graph.junction_start),
        np.array(graph.junction_xy),
        size,
    )


def _bases(counts: Iterable[int]) -> Ints:
    return np.cumsum([0, *counts]).astype(np.int32)


def _table(
    free: Sequence[tuple[int, Corridor]], own: Sequence[tuple[int, Corridor]], lane_base: Ints
) -> RouteTable:
    worlds = [world for world, _ in (*free, *own)]
    corridors = [corridor for _, corridor in (*free, *own)]
    row_base = _bases(len(corridor.lane) for corridor in corridors)
    group_base = _bases(int(corridor.group.max(initial=-1)) + 1 for corridor in corridors)

    def joined(parts: Iterable[NDArray], dtype: type = np.int32) -> NDArray:
        return np.concatenate(list(parts)).astype(dtype)

    counts = joined(np.diff(corridor.onward_start) for corridor in corridors)
    return RouteTable(
        free=len(free),
        start=row_base,
        lane=joined(c.lane + lane_base[world] for c, world in zip(corridors, worlds, strict=True)),
        group=joined(c.group + base for c, base in zip(corridors, group_base, strict=False)),
        begin=joined((c.begin for c in corridors), np.float64),
        end=joined((c.end for c in corridors), np.float64),
        onward_start=_bases(counts),
        onward=joined(c.onward + base for c, base in zip(corridors, row_base, strict=False)),
        before=joined(
            np.where(c.before >= 0, c.before + base, -1) for c, base in zip(corridors, row_base, strict=False)
        ),
        by_lane=joined(
            np.argsort(c.lane, kind="stable") + base for c, base in zip(corridors, row_base, strict=False)
        ),
    )
