"""What can be asked of each sensor; names and defaults of the fields are the original's."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from smarts.errors import SmartsError

LARGEST_IMAGE = 2048
"""Pixels along a side."""


class InterfaceError(SmartsError):
    """An agent's interface asks for something that cannot be had."""


def _demand(holds: bool, option: object, wanted: str) -> None:
    if not holds:
        values = ", ".join(f"{field.name}={getattr(option, field.name)!r}" for field in fields(option))  # pyright: ignore[reportArgumentType]
        raise InterfaceError(f"{wanted}, but got {values}", place=type(option).__name__)


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
        for side in (self.width, self.height):
            _demand(1 <= side <= LARGEST_IMAGE, self, f"width and height are within 1 and {LARGEST_IMAGE}")
        _demand(0 < self.resolution < math.inf, self, "resolution is above 0")


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
        object.__setattr__(self, "laser_angles", tuple(float(angle) for angle in self.laser_angles))
        _demand(self.angle_resolution > 0 and self.rays_around >= 1, self, "there is a ray around")
        _demand(len(self.laser_angles) >= 1, self, "there is a laser")
        _demand(0 < self.max_distance < math.inf, self, "max_distance is above 0")

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
        _demand(self.lookahead >= 1 and self.paths >= 1, self, "lookahead and paths are at least 1")
        _demand(0 < self.spacing < math.inf, self, "spacing is above 0")


@dataclass(frozen=True)
class RoadWaypoints:
    """Waypoints behind and ahead in all lanes of the road, oncoming ones included."""

    horizon: int = 20
    """How many waypoints, a metre apart, lie behind and how many ahead of the vehicle."""
    lanes: int = 8
    """The most lanes (not in the original)."""

    def __post_init__(self) -> None:
        _demand(self.horizon >= 0 and self.lanes >= 1, self, "horizon is at least 0 and lanes at least 1")


@dataclass(frozen=True)
class NeighborhoodVehicles:
    """The nearest other vehicles."""

    radius: float | None = None
    """Within which vehicles are seen, centre to centre [m]; None: however far."""
    most: int = 32
    """The most vehicles (not in the original)."""

    def __post_init__(self) -> None:
        _demand(self.radius is None or self.radius > 0, self, "radius is above 0, or None")
        _demand(self.most >= 1, self, "most is at least 1")


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
        _demand(self.lookahead > 0 and self.most >= 1, self, "lookahead is above 0 and most at least 1")


@dataclass(frozen=True)
class Vias:
    """The mission's via points near the vehicle; every agent has this sensor."""

    acquisition_range: float = 40.0
    """How near a via point must be [m]."""
    most: int = 8
    """The most via points."""
