"""What `Observation` objects consist of; names of the fields are the original's.

Headings are counter-clockwise from +x, unlike the original's, which are from north.
"""

from __future__ import annotations

import enum
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smarts.types.coordinates import Dimensions, Heading, Point, RefLinePoint
from smarts.types.mission import GoalKind

Floats = NDArray[np.float64]
Triple = tuple[float, float, float]


class Collision(NamedTuple):
    """A vehicle that was touched."""

    collidee_id: str
    """Its public name."""


class Events(NamedTuple):
    """What happened to the agent."""

    collisions: tuple[Collision, ...]
    off_road: bool
    off_route: bool
    on_shoulder: bool
    wrong_way: bool
    not_moving: bool
    reached_goal: bool
    reached_max_episode_steps: bool
    agents_alive_done: bool
    interest_done: bool
    missed_goal: bool = False
    """Not in the original."""


class GoalObservation(NamedTuple):
    """Where a mission ends."""

    kind: GoalKind
    position: Point
    """[m]; the origin if the goal is no place."""
    radius: float
    """[m]"""

    def is_specific(self) -> bool:
        """Return whether the goal is a place."""
        return self.kind not in (GoalKind.ENDLESS, GoalKind.OFF_MAP)


class MissionObservation(NamedTuple):
    """Where the agent is bound for."""

    goal: GoalObservation
    route_length: float
    """From start to goal [m]; 0 if there is no end."""
    remaining: float
    """Of the route [m]."""
    laps: int
    lap: int
    """Laps completed."""


class VehicleObservation(NamedTuple):
    """Another vehicle."""

    id: str
    position: Triple
    """Centre of the footprint [m]."""
    bounding_box: Dimensions
    heading: Heading
    speed: float
    """[m/s]"""
    road_id: str
    """Of the road that it is on, or that is nearest; "" if there is none."""
    lane_id: str
    lane_index: int
    """0 is the rightmost."""
    lane_position: RefLinePoint | None = None
    interest: bool = False
    """Whether the scenario marks it."""

    @property
    def edge_id(self) -> str:
        """Older name of `road_id`."""
        return self.road_id


class EgoVehicleObservation(NamedTuple):
    """The agent's own vehicle."""

    id: str
    position: Triple
    """Centre of the footprint [m]."""
    bounding_box: Dimensions
    heading: Heading
    speed: float
    """[m/s]"""
    steering: float
    """Of the front wheels, positive to the left [rad]."""
    yaw_rate: float
    """[rad/s]"""
    road_id: str
    """Of the road that it is on, or that is nearest; "" if there is none."""
    lane_id: str
    lane_index: int
    """0 is the rightmost."""
    mission: MissionObservation
    linear_velocity: Triple
    """In the map frame [m/s]."""
    angular_velocity: Triple
    """[rad/s]"""
    linear_acceleration: Triple | None
    """In the map frame [m/s^2]; this and the following need the accelerometer."""
    angular_acceleration: Triple | None
    """[rad/s^2]"""
    linear_jerk: Triple | None
    """In the map frame [m/s^3]."""
    angular_jerk: Triple | None
    """[rad/s^3]"""
    lane_position: RefLinePoint | None = None

    @property
    def edge_id(self) -> str:
        """Older name of `road_id`."""
        return self.road_id


class Waypoint(NamedTuple):
    """A point on the centreline of a lane."""

    pos: Floats
    """[m], shape (2,)."""
    heading: Heading
    lane_id: str
    lane_width: float
    """[m]"""
    speed_limit: float
    """[m/s]"""
    lane_index: int
    """0 is the rightmost."""
    lane_offset: float
    """Along the lane from its begin [m]."""

    @property
    def pose(self) -> tuple[float, float, float]:
        """Return x, y [m] and heading [rad]."""
        return float(self.pos[0]), float(self.pos[1]), float(self.heading)

    def relative_heading(self, heading: float) -> Heading:
        """Return how far the waypoint points to the left of a heading [rad]."""
        return Heading(self.heading - heading)

    def signed_lateral_error(self, position: Floats | tuple[float, ...]) -> float:
        """Return how far to the left of the waypoint's line a position is [m]."""
        x, y = position[0] - self.pos[0], position[1] - self.pos[1]
        return float(y * math.cos(self.heading) - x * math.sin(self.heading))

    def dist_to(self, position: Floats | tuple[float, ...]) -> float:
        """Return the distance to a position [m]."""
        return math.hypot(position[0] - self.pos[0], position[1] - self.pos[1])


class RoadWaypoints(NamedTuple):
    """Waypoints in all lanes of the road."""

    lanes: dict[str, list[list[Waypoint]]]
    """By the id of the lane that is beside the vehicle; one path for each."""


class ViaPoint(NamedTuple):
    """A point to pass on the way."""

    position: tuple[float, float]
    """[m]"""
    lane_index: int
    road_id: str
    required_speed: float
    """[m/s]"""
    hit: bool
    """Whether it has been passed."""


class Vias(NamedTuple):
    """The via points near the vehicle, nearest first."""

    near_via_points: tuple[ViaPoint, ...]

    @property
    def hit_via_points(self) -> tuple[ViaPoint, ...]:
        """Those that have been passed."""
        return tuple(point for point in self.near_via_points if point.hit)


class SignalLightState(enum.IntFlag):
    """What a light shows; numbers are the original's."""

    UNKNOWN = 0
    OFF = 0
    STOP = 1
    CAUTION = 2
    GO = 4


class SignalObservation(NamedTuple):
    """A traffic light ahead."""

    state: SignalLightState
    stop_point: Point
    controlled_lanes: tuple[str, ...]
    """The lane behind the light, inside the junction."""
    last_changed: float | None = None
    """Not known here."""


class GridMapMetadata(NamedTuple):
    """How to find places in a picture."""

    resolution: float
    """Side of a pixel [m]."""
    width: int
    height: int
    camera_position: Triple
    """Of the picture's middle in the map [m]."""
    camera_heading: float
    """Which way the upper edge is [rad]."""


class GridMap(NamedTuple):
    """A picture from above."""

    metadata: GridMapMetadata
    data: NDArray[np.uint8]
    """Shape (height, width, channels)."""


LidarPointCloud = tuple[list[Floats], list[bool], list[tuple[Floats, Floats]]]
"""Points [m], infinite where a ray met nothing; whether each ray met something; origin and vector of each."""
