"""What can be asked of each sensor; names and defaults of the fields are the original's."""

from __future__ import annotations

import math
from typing import Annotated

from smarts.agents.checks import Count, Listed, Number, Positive, WholeFrom0, checked
from smarts.agents.checks import InterfaceError as InterfaceError


@checked
class _Image:
    """A picture from above: the vehicle in the middle, its front towards the upper edge."""

    width: Count = 256
    """Columns."""
    height: Count = 256
    """Rows."""
    resolution: Positive = 50 / 256
    """Side of a pixel [m]."""


@checked
class DrivableAreaGridMap(_Image):
    """Where there is road."""


@checked
class OGM(_Image):
    """Occupancy grid map: where there are vehicles."""


@checked
class RGB(_Image):
    """Road and vehicles in colour."""


@checked
class OcclusionMap(_Image):
    """What other vehicles do not hide."""

    surface_noise: bool = True
    """Has no effect: there are no hills on our maps. Kept so that the original's interfaces can be read."""


@checked
class SensorParams:
    """Rays of a lidar."""

    start_angle: Number
    """Angle of the first ray around, from straight ahead counter-clockwise [rad]."""
    end_angle: Number
    """[rad]"""
    laser_angles: Annotated[tuple[Number, ...], Listed]
    """How far up each laser looks [rad]; any sequence of numbers will do."""
    angle_resolution: Positive
    """Angle between rays around [rad]."""
    max_distance: Positive
    """[m]"""
    noise_mu: Number
    """Has no effect, as in the original [m]."""
    noise_sigma: Number
    """Has no effect, as in the original [m]."""

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


@checked
class Lidar:
    """Points on vehicles and on the ground, hit by rays from above the roof."""

    sensor_params: SensorParams = BasicLidar


@checked
class Waypoints:
    """Paths ahead along the route, one in each lane."""

    lookahead: Count = 32
    """Waypoints of a path."""
    spacing: Positive = 1.0
    """Distance between waypoints [m] (not in the original)."""
    paths: Count = 8
    """The most paths (not in the original)."""


@checked
class RoadWaypoints:
    """Waypoints behind and ahead in all lanes of the road, oncoming ones included."""

    horizon: WholeFrom0 = 20
    """How many waypoints, a metre apart, lie behind and how many ahead of the vehicle."""
    lanes: Count = 8
    """The most lanes (not in the original)."""


@checked
class NeighborhoodVehicles:
    """The nearest other vehicles."""

    radius: Positive | None = None
    """Distance within which vehicles are seen, centre to centre [m]; None: however far."""
    most: Count = 32
    """The most vehicles (not in the original)."""


@checked
class Accelerometer:
    """Acceleration and jerk."""


@checked
class LanePositions:
    """The place along and across the lane."""


@checked
class Signals:
    """Traffic lights ahead."""

    lookahead: Positive = 100.0
    """How far along the road ahead [m]."""
    most: Count = 4
    """The most signals (not in the original)."""


@checked
class Vias:
    """The mission's via points near the vehicle; every agent has this sensor."""

    acquisition_range: Positive = 40.0
    """How near a via point must be [m]."""
    most: Count = 8
    """The most via points."""
