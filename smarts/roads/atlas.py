"""The road atlas: several maps at once, so that one call answers for vehicles of many simulations."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from smarts.arrays import Floats, Ints
from smarts.geometry.binding import bind
from smarts.roads import kernels
from smarts.roads.arrays import RouteTable
from smarts.roads.corridors import free_corridor, route_corridor
from smarts.roads.lane_graph import LaneGraph, LaneKind
from smarts.roads.paces import write_paces
from smarts.roads.packing import pack_roads, pack_routes

_BESIDE = 1.0
"""Distance beyond a road's left edge at which the opposite road is searched [m]."""
ROAD_LANES = frozenset({LaneKind.CAR, LaneKind.BUS})
"""The lanes that are road to a motor vehicle."""
_ROAD_MASK = sum(1 << kind for kind in ROAD_LANES)


class NearestLanes(NamedTuple):
    """The nearest lanes of E poses on their maps."""

    lane: Ints
    """Lane within the map, -1 where there is none, shape (E,)."""
    s: Floats
    """Arc length of the foot on the centreline [m], shape (E,)."""
    t: Floats
    """Signed lateral error: offset from the centreline, positive to the left [m], shape (E,)."""
    distance: Floats
    """Distance from the centreline [m]: |t|, or more behind an end of the lane, shape (E,)."""

    @classmethod
    def allocate(cls, count: int) -> NearestLanes:
        """Return buffers for `count` poses."""
        return cls(np.empty(count, np.int32), np.empty(count), np.empty(count), np.empty(count))


class RoadAtlas:
    """Several road maps. A pose belongs to the map that its map number names.

    Kernels read `roads`, the lanes of all maps, and a `RouteTable` of this atlas. They check nothing: map,
    lane and route numbers must exist.
    """

    def __init__(self, graphs: Sequence[LaneGraph]) -> None:
        self.graphs = tuple(graphs)
        self.roads = pack_roads(self.graphs)
        self.no_routes = self.route_table(())
        self._locate = bind(kernels.locate, self.roads, self.no_routes)
        self._paces: dict[bytes, Floats] = {}
        self._find_twins()

    def route_table(self, routes: Iterable[tuple[int, Sequence[str]]]) -> RouteTable:
        """Return a table of routes, each a map number and the ids of its road edges; route i is the i-th.

        Raises:
            MapError: A route has an unknown edge, one without lanes for road users, or a gap.
        """
        free = [(world, free_corridor(graph, ROAD_LANES)) for world, graph in enumerate(self.graphs)]
        own = [(m, route_corridor(self.graphs[m], tuple(route), ROAD_LANES)) for m, route in routes]
        return pack_routes(free, own, self.roads.lane_base)

    def locate(self, maps: Ints, position: Floats, heading: Floats, *, height: Floats) -> NearestLanes:
        """Return the road lane that each pose is on, else the nearest one; `kernels.locate` gives the rule.

        Args:
            maps: Map numbers, shape (E,).
            position: [m], shape (E, 2).
            heading: [rad], shape (E,): of overlapping lanes, prefer those that fit it.
            height: Height of the road [m], NaN where it is unknown, shape (E,).
        """
        found = NearestLanes.allocate(len(maps))
        self._locate(maps, position, height, heading, np.full(len(maps), -1, np.int32), _ROAD_MASK, *found)
        return found

    def paces(self, agility: Floats) -> Floats:
        """Return how fast kinds of vehicles drive each lane [m/s], shape (L, K); see `Performance.pace`.

        The table is made by the first call with an `agility`; later calls return the same array.

        Args:
            agility: See `Performance`, shape (K,).
        """
        found = self._paces.get(agility.tobytes())
        if found is None:
            found = self._paces[agility.tobytes()] = np.empty((self.roads.lane_base[-1], len(agility)))
            bind(write_paces, self.roads)(agility, found)
        return found

    def _find_twins(self) -> None:
        """Write `lane_twin`: look beyond each road's left edge for a lane of the other direction."""
        roads, counts = self.roads, [len(graph.lane_ids) for graph in self.graphs]
        maps = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
        lane = np.concatenate([np.arange(count, dtype=np.int32) for count in counts])
        length = np.concatenate([graph.length for graph in self.graphs])
        width = np.concatenate([graph.width for graph in self.graphs])
        poses_at = bind(kernels.poses_at, roads)
        zeros, position, heading = np.zeros(len(lane)), np.empty((len(lane), 2)), np.empty(len(lane))
        poses_at(maps, lane, length / 2, width / 2 + _BESIDE, position, heading)
        height = roads.point_z[(roads.point_start[:-1] + roads.point_start[1:]) // 2]
        found = self.locate(maps, position, heading + np.pi, height=height)
        s, other_heading = np.empty(len(lane)), np.empty(len(lane))
        bind(kernels.project_on_lanes, roads)(maps, found.lane, position, height, s, np.empty(len(lane)))
        poses_at(maps, found.lane, s, zeros, position, other_heading)
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
