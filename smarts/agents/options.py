"""What can be asked of each sensor; names and defaults of the fields are the original's."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from smarts.agents.checks import InterfaceError as InterfaceError
from smarts.agents.checks import (
    check_instance,
    check_list,
    check_number,
    check_whole,
    keep_number,
    keep_whole,
)

LARGEST_IMAGE = 2048
"""Pixels along a side."""
FINEST, COARSEST = 1e-3, 1e3
"""Sides of a pixel [m]."""
MOST_RAYS = 200_000
"""Of a lidar."""
FARTHEST = 1e6
"""Farther than any map reaches [m]."""
LONGEST_PATH = 10_000
"""Waypoints."""
MOST_SEEN = 10_000
"""Vehicles, paths, lanes, signals or via points."""
FINEST_ANGLE, WIDEST_ANGLE = 1e-6, 1e3
"""[rad]"""


@dataclass(frozen=True)
class _Image:
    """A picture from above: the vehicle in the middle, its front towards the upper edge."""

    width: int = 256
    """Columns."""
    height: int = 256
    """Rows."""
    resolution: float = 50 / 256
    """Side of a pixel [m]."""

    def __post_init__(self) -> None:
        for side in ("width", "height"):
            keep_whole(self, side, 1, LARGEST_IMAGE)
        keep_number(self, "resolution", least=FINEST, most=COARSEST)


@dataclass(frozen=True)
class DrivableAreaGridMap(_Image):
    """Where there is road."""


@dataclass(frozen=True)
class OGM(_Image):
    """Occupancy grid map: where there are vehicles."""


@dataclass(frozen=True)
class RGB(_Image):
    """Road and vehicles in colour."""


@dataclass(frozen=True)
class OcclusionMap(_Image):
    """What other vehicles do not hide."""

    surface_noise: bool = True
    """Without effect: there are no hills on our maps. Kept so that the original's interfaces can be read."""


@dataclass(frozen=True)
class SensorParams:
    """Rays of a lidar."""

    start_angle: float
    """Of the first ray around, from straight ahead counter-clockwise [rad]."""
    end_angle: float
    """[rad]"""
    laser_angles: tuple[float, ...]
    """How far up each laser looks [rad]; any sequence of numbers will do."""
    angle_resolution: float
    """Between rays around [rad]."""
    max_distance: float
    """[m]"""
    noise_mu: float
    """Without effect, as in the original [m]."""
    noise_sigma: float
    """Without effect, as in the original [m]."""

    def __post_init__(self) -> None:
        place = "SensorParams"
        if isinstance(self.laser_angles, Iterable) and not isinstance(self.laser_angles, str):
            # Arrays and generators are sequences of numbers, too.
            object.__setattr__(self, "laser_angles", tuple(self.laser_angles))
        check_list("laser_angles", self.laser_angles, (int, float, np.number), "[-0.1, 0.0, 0.1]", place)
        for angle in ("start_angle", "end_angle"):
            keep_number(self, angle, least=-WIDEST_ANGLE, most=WIDEST_ANGLE)
        for angle in self.laser_angles:
            check_number("one of laser_angles", angle, least=-WIDEST_ANGLE, most=WIDEST_ANGLE, place=place)
        object.__setattr__(self, "laser_angles", tuple(map(float, self.laser_angles)))
        keep_number(self, "angle_resolution", least=FINEST_ANGLE, most=WIDEST_ANGLE)
        keep_number(self, "max_distance", most=FARTHEST, above=True)
        for noise in ("noise_mu", "noise_sigma"):
            keep_number(self, noise, least=-FARTHEST, most=FARTHEST)
        rays = len(self.laser_angles) * self.rays_around
        check_whole("lasers times rays around", rays, 1, MOST_RAYS, place)

    @property
    def rays_around(self) -> int:
        """How many directions each laser looks in."""
        return int((self.end_angle - self.start_angle) / self.angle_resolution)


def _spread(first_degrees: float, last_degrees: float, count: int) -> tuple[float, ...]:
    """Return angles at equal distances [rad]."""
    step = (last_degrees - first_degrees) / (count - 1)
    return tuple(math.radians(first_degrees + number * step) for number in range(count))


BasicLidar = SensorParams(0.0, 2 * math.pi, _spread(-4, 10, 50), 1.0, 20.0, 0.0, 0.078)
VelodyneHDL32E = SensorParams(0.0, 2 * math.pi, _spread(-30.67, 10.67, 24), 0.1728, 100.0, 0.0, 0.078)


@dataclass(frozen=True)
class Lidar:
    """Points on vehicles and on the ground, hit by rays from above the roof."""

    sensor_params: SensorParams = BasicLidar

    def __post_init__(self) -> None:
        example = "SensorParams(...), BasicLidar or VelodyneHDL32E"
        check_instance("sensor_params", self.sensor_params, SensorParams, example, "Lidar")


@dataclass(frozen=True)
class Waypoints:
    """Paths ahead along the route, one in each lane."""

    lookahead: int = 32
    """Waypoints of a path."""
    spacing: float = 1.0
    """Between waypoints [m] (not in the original)."""
    paths: int = 8
    """The most paths (not in the original)."""

    def __post_init__(self) -> None:
        keep_whole(self, "lookahead", 1, LONGEST_PATH)
        keep_number(self, "spacing", most=FARTHEST, above=True)
        keep_whole(self, "paths", 1, MOST_SEEN)


@dataclass(frozen=True)
class RoadWaypoints:
    """Waypoints behind and ahead in all lanes of the road, oncoming ones included."""

    horizon: int = 20
    """How many waypoints, a metre apart, lie behind and how many ahead of the vehicle."""
    lanes: int = 8
    """The most lanes (not in the original)."""

    def __post_init__(self) -> None:
        keep_whole(self, "horizon", 0, LONGEST_PATH)
        keep_whole(self, "lanes", 1, MOST_SEEN)


@dataclass(frozen=True)
class NeighborhoodVehicles:
    """The nearest other vehicles."""

    radius: float | None = None
    """Within which vehicles are seen, centre to centre [m]; None: however far."""
    most: int = 32
    """The most vehicles (not in the original)."""

    def __post_init__(self) -> None:
        if self.radius is not None:
            keep_number(self, "radius", above=True)
        keep_whole(self, "most", 1, MOST_SEEN)


@dataclass(frozen=True)
class Accelerometer:
    """Acceleration and jerk."""


@dataclass(frozen=True)
class LanePositions:
    """The place along and across the lane."""


@dataclass(frozen=True)
class Signals:
    """Traffic lights ahead."""

    lookahead: float = 100.0
    """How far along the road ahead [m]."""
    most: int = 4
    """The most signals (not in the original)."""

    def __post_init__(self) -> None:
        keep_number(self, "lookahead", above=True)
        keep_whole(self, "most", 1, MOST_SEEN)


@dataclass(frozen=True)
class Vias:
    """The mission's via points near the vehicle; every agent has this sensor."""

    acquisition_range: float = 40.0
    """How near a via point must be [m]."""
    most: int = 8
    """The most via points."""
