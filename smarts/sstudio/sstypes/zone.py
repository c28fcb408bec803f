"""Areas of the map."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from smarts.sstudio.sstypes.identity import Described

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

    from smarts.roads.lane_graph import LaneGraph


@dataclass(frozen=True, eq=False)
class Zone(Described, ABC):
    """An area of the map."""

    @abstractmethod
    def to_geometry(self, road_map: LaneGraph | None = None) -> BaseGeometry:
        """Return the area in the map frame [m].

        Args:
            road_map: The map, which zones along lanes need.
        """


@dataclass(frozen=True, eq=False)
class MapZone(Zone):
    """A stretch of neighbouring lanes."""

    start: tuple[str, int, Any]
    """Edge, index of the rightmost lane, and offset: metres, "base", "max" (ends with the lane), "random".

    A random one is drawn once for all lanes: in each episode for areas in which an agent takes a vehicle
    over, once for bubbles and road surfaces.
    """
    length: float | str
    """Length along the lanes [m], or "max"; cut to the lanes' length."""
    n_lanes: int = 2
    """Number of lanes, from right to left."""

    def to_geometry(self, road_map: LaneGraph | None = None) -> BaseGeometry:
        """Return the union of the lanes' strips, each 0.3 m wider than its lane, so that no gap is left.

        Raises:
            MapError: The edge or one of the lanes is not on the map.
        """
        from smarts.sstudio.sstypes.zone_geometry import lane_strips

        assert road_map is not None
        return lane_strips(road_map, self.start, self.length, self.n_lanes)


@dataclass(frozen=True, eq=False)
class PositionalZone(Zone):
    """A rectangle."""

    pos: tuple[float, float]
    """Its centre [m]."""
    size: tuple[float, float]
    """Its extent along x and y before it is turned [m]."""
    rotation: float | None = None
    """Counter-clockwise rotation about its centre [rad]."""

    def to_geometry(self, road_map: LaneGraph | None = None) -> BaseGeometry:
        """Return the rectangle."""
        from smarts.sstudio.sstypes.zone_geometry import polygon

        (x, y), (along, across) = self.pos[:2], self.size
        corners = (x - along / 2, y - across / 2), (x + along / 2, y + across / 2)
        return polygon(corners, self.rotation or 0.0)


@dataclass(frozen=True, eq=False)
class ConfigurableZone(Zone):
    """A polygon."""

    ext_coordinates: Sequence[tuple[float, float]]
    """Its corners in order [m]; two of them make a rectangle along the axes."""
    rotation: float | None = None
    """Counter-clockwise rotation about the centre of its bounding box [rad]."""

    def to_geometry(self, road_map: LaneGraph | None = None) -> BaseGeometry:
        """Return the polygon."""
        from smarts.sstudio.sstypes.zone_geometry import polygon

        return polygon(self.ext_coordinates, self.rotation or 0.0)


@dataclass(frozen=True, eq=False)
class RoadSurfacePatch(Described):
    """An area of other friction."""

    zone: Zone
    """The area."""
    begin_time: float
    """Begin [s]."""
    end_time: float
    """End [s]."""
    friction_coefficient: float
    """The friction there; dry asphalt has about 0.9."""
