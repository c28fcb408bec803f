"""Routes over roads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from smarts.sstudio.sstypes.drawing import drawing
from smarts.sstudio.sstypes.identity import Described
from smarts.sstudio.sstypes.map_spec import MapSpec

if TYPE_CHECKING:
    from smarts.roads.lane_graph import LaneGraph


@dataclass(frozen=True, eq=False)
class JunctionEdgeIDResolver(Described):
    """The edge inside a junction that joins two lanes; its id is known only once the map is built."""

    start_edge_id: str
    start_lane_index: int
    end_edge_id: str
    end_lane_index: int

    def to_edge(self, roads: LaneGraph) -> str:
        """Return the id of the junction's edge.

        Raises:
            MapError: An edge or lane is not on the map, or nothing joins the two lanes.
        """
        from smarts.sstudio.junctions import connecting_edge

        begin = roads.lane_number(self.start_edge_id, self.start_lane_index)
        end = roads.lane_number(self.end_edge_id, self.end_lane_index)
        return connecting_edge(roads, begin, end)


@dataclass(frozen=True, eq=False)
class Route(Described):
    """A way from one place to another; the shortest one through the edges of `via`."""

    begin: tuple[str, int, Any]
    """Edge, lane index (0 is the rightmost) and offset along the lane: metres, "base", "max" or "random"."""
    end: tuple[str, int, Any]
    """As `begin`."""
    via: Sequence[str] = ()
    """Edges to pass on the way, in this order."""
    map_spec: MapSpec | None = None
    """In the original a map of the route's own; here routes are on the scenario's map, so leave it out."""

    @property
    def id(self) -> str:
        """A name that tells begin and end, and is unique to the content."""
        begin, end = ("_".join(map(str, place)) for place in (self.begin, self.end))
        return f"{begin}-{end}-{self.fingerprint()}"

    @property
    def roads(self) -> tuple[str, ...]:
        """The edges that the route names, begin and end included."""
        return (self.begin[0], *self.via, self.end[0])

    @property
    def edges(self) -> tuple[str, ...]:
        """Former name of `roads`."""
        return self.roads


@dataclass(frozen=True, eq=False)
class RandomRoute(Described):
    """A route drawn from the map.

    Every `RandomRoute()` is another one; one object used twice, or two of the same `id`, are one route.
    """

    id: str = field(default_factory=lambda: drawing().serial("random-route"))
    map_spec: MapSpec | None = None
    """In the original a map of the route's own; here routes are on the scenario's map, so leave it out."""
