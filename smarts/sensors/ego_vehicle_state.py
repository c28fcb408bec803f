"""The agent's own vehicle."""

from __future__ import annotations

import math
from collections import namedtuple
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.sensors.bounds import FARTHEST, FASTEST, FASTEST_TURN, LARGEST_BOX, MOST, clipped, clipped_above
from smarts.sensors.heights import vehicle_height
from smarts.sensors.mission import MissionObservation
from smarts.sensors.protocol import KernelSensor, Readings, Seen, Triple, triple
from smarts.types.coordinates import Dimensions, Heading, RefLinePoint
from smarts.types.interface import Field
from smarts.types.world import State


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
    """Angle of the front wheels, positive to the left [rad]."""
    yaw_rate: float
    """[rad/s]"""
    road_id: str
    """Id of the road that the vehicle is on, or that is nearest; "" if there is none."""
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


_Out = namedtuple(
    "_Out",
    "position bounding_box heading speed steering yaw_rate linear_velocity lane lane_index "
    "distance_travelled",
)


@dataclass(frozen=True)
class EgoVehicleState(KernelSensor):
    """Pose, size and motion of the agent's vehicle, and the lane that it is on."""

    arrays: ClassVar[type] = _Out

    def fields(self) -> tuple[Field, ...]:
        """Return the fields."""
        moving = "of the centre of gravity along x and y"
        return (
            Field("position", (3,), np.float64, -FARTHEST, FARTHEST, "m", "centre of the footprint"),
            Field("bounding_box", (3,), np.float32, 0, LARGEST_BOX, "m", "length, width, height"),
            Field("heading", (), np.float32, -np.pi, np.pi, "rad", "counter-clockwise from +x"),
            Field("speed", (), np.float32, -FASTEST, FASTEST, "m/s", "along the heading"),
            Field("steering", (), np.float32, -np.pi, np.pi, "rad", "of the front wheels, left positive"),
            Field("yaw_rate", (), np.float32, -FASTEST_TURN, FASTEST_TURN, "rad/s", "counter-clockwise"),
            Field("linear_velocity", (2,), np.float32, -2 * FASTEST, 2 * FASTEST, "m/s", moving),
            Field("lane", (), np.int32, -1, MOST, "", "number in the map, -1 if there is none"),
            Field("lane_index", (), np.int32, 0, MOST, "", "place across the road, 0 is the rightmost"),
            Field("distance_travelled", (), np.float32, 0, FARTHEST, "m", "driven since entry"),
        )

    @staticmethod
    @kernel
    def write(state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: _Out) -> None:
        """Write an agent's readings; see `KernelSensor`."""
        vehicles, agents = state.vehicles, state.agents
        v = agents.slot[b, a]
        out.position[b, g, 0] = clipped(vehicles.position[b, v, 0], FARTHEST)
        out.position[b, g, 1] = clipped(vehicles.position[b, v, 1], FARTHEST)
        out.position[b, g, 2] = clipped(vehicles.height[b, v], FARTHEST)
        out.bounding_box[b, g, 0] = clipped_above(vehicles.length[b, v], LARGEST_BOX)
        out.bounding_box[b, g, 1] = clipped_above(vehicles.width[b, v], LARGEST_BOX)
        out.bounding_box[b, g, 2] = vehicle_height(vehicles.kind[b, v])
        out.heading[b, g] = clipped(vehicles.heading[b, v], math.pi)
        forward = clipped(vehicles.speed[b, v], FASTEST)
        aside = clipped(vehicles.lateral_speed[b, v], FASTEST)
        cosine, sine = math.cos(out.heading[b, g]), math.sin(out.heading[b, g])
        out.speed[b, g] = forward
        out.steering[b, g] = clipped(agents.steering[b, a], math.pi)
        out.yaw_rate[b, g] = clipped(vehicles.yaw_rate[b, v], FASTEST_TURN)
        out.linear_velocity[b, g, 0] = forward * cosine - aside * sine
        out.linear_velocity[b, g, 1] = forward * sine + aside * cosine
        lane = vehicles.lane[b, v]
        out.lane[b, g] = lane
        out.lane_index[b, g] = roads.lane_index[roads.lane_base[state.map[b]] + lane] if lane >= 0 else 0
        out.distance_travelled[b, g] = clipped_above(agents.distance_travelled[b, a], FARTHEST)

    @staticmethod
    def as_object(readings: Readings, seen: Seen) -> EgoVehicleObservation:
        """Return the vehicle with the agent's mission, and what its other sensors say about it."""
        yaw_rate = float(readings["yaw_rate"])
        road_id, lane_id = seen.lane_ids(int(readings["lane"]))
        motion = seen.accelerometer or (None, None, None, None)
        acceleration, angular_acceleration, jerk, angular_jerk = motion
        return EgoVehicleObservation(
            seen.name,
            triple(readings["position"]),
            Dimensions(*triple(readings["bounding_box"])),
            Heading(float(readings["heading"])),
            float(readings["speed"]),
            float(readings["steering"]),
            yaw_rate,
            road_id,
            lane_id,
            int(readings["lane_index"]),
            seen.mission,
            triple(readings["linear_velocity"]),
            (0.0, 0.0, yaw_rate),
            acceleration,
            angular_acceleration,
            jerk,
            angular_jerk,
            seen.lane_positions,
        )
