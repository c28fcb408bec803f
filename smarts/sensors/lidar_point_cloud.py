"""Points on vehicles and on the ground, as a lidar above the roof of the agent's vehicle finds them."""

from __future__ import annotations

import math
from collections import namedtuple
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from smarts.agents.options import Lidar
from smarts.arrays import Floats
from smarts.geometry.boxes import slab
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.levels import meets
from smarts.roads.scene import Scene
from smarts.sensors.bounds import FARTHEST, LARGEST_BOX, clipped, clipped_above
from smarts.sensors.heights import vehicle_height
from smarts.sensors.protocol import KernelSensor, Readings, Seen
from smarts.types.interface import Field
from smarts.types.vehicles import VehicleStates
from smarts.types.world import State

ABOVE_ROOF = 0.3
"""Where rays begin [m]."""

LidarPointCloud = tuple[list[Floats], list[bool], list[tuple[Floats, Floats]]]
"""Points [m], infinite where a ray has no hit; whether each ray has a hit; origin and vector of each."""


_Out = namedtuple("_Out", "point hit ray")
"""Shape (B, G, R, ...), R rays."""


@dataclass(frozen=True)
class LidarPoints(KernelSensor):
    """Where each ray first meets the ground or the box of another vehicle.

    Rays are ordered by laser, and for each laser counter-clockwise from its start angle. There is no noise.
    """

    option: Lidar = field(default_factory=Lidar)
    arrays: ClassVar[type] = _Out

    def fields(self) -> tuple[Field, ...]:
        """Return the fields."""
        reach = self.option.sensor_params.max_distance
        rays = len(self.option.sensor_params.laser_angles) * self.option.sensor_params.rays_around
        return (
            Field("point", (rays, 3), np.float64, -FARTHEST, FARTHEST, "m", "in the map; 0 without a hit"),
            Field("hit", (rays,), np.int8, 0, 1, "", "1 if the ray met something"),
            Field("ray", (rays, 3), np.float32, -reach, reach, "m", "from where rays begin to their ends"),
        )

    def directions(self) -> Floats:
        """Return the rays' unit vectors in the frame of the vehicle (ahead, left, up), shape (R, 3)."""
        params = self.option.sensor_params
        up = np.repeat(np.array(params.laser_angles), params.rays_around)
        around = params.start_angle + params.angle_resolution * np.arange(params.rays_around)
        around = np.tile(around, len(params.laser_angles))
        level = np.cos(up)
        return np.stack((level * np.cos(around), level * np.sin(around), np.sin(up)), axis=-1)

    def known(self, scene: Scene) -> tuple[Any, ...]:
        """Return what the kernel needs besides the state."""
        boxes = np.empty((scene.world.vehicles.alive.shape[1], 7))
        return ((self.directions(), float(self.option.sensor_params.max_distance), boxes),)

    @staticmethod
    @kernel
    def write(
        state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: _Out, known: Any
    ) -> None:
        """Write an agent's readings; see `KernelSensor`."""
        directions, reach, boxes = known
        vehicles, own = state.vehicles, state.agents.slot[b, a]
        count = _boxes_within(vehicles, b, own, reach, boxes)
        x = clipped(vehicles.position[b, own, 0], FARTHEST)
        y = clipped(vehicles.position[b, own, 1], FARTHEST)
        z, ground = vehicle_height(vehicles.kind[b, own]) + ABOVE_ROOF, vehicles.height[b, own]
        direction = clipped(vehicles.heading[b, own], math.pi)
        cosine, sine = math.cos(direction), math.sin(direction)
        for ray in range(len(directions)):
            ahead, left, up = directions[ray]
            dx, dy = ahead * cosine - left * sine, ahead * sine + left * cosine
            nearest = -z / up if up < 0.0 else np.inf
            for box in range(count):
                nearest = min(nearest, _distance_to_box(x, y, z, dx, dy, up, boxes[box]))
            out.ray[b, g, ray, 0] = clipped(reach * dx, reach)
            out.ray[b, g, ray, 1] = clipped(reach * dy, reach)
            out.ray[b, g, ray, 2] = clipped(reach * up, reach)
            hit = nearest <= reach
            out.hit[b, g, ray] = hit
            out.point[b, g, ray, 0] = clipped(x + nearest * dx, FARTHEST) if hit else 0.0
            out.point[b, g, ray, 1] = clipped(y + nearest * dy, FARTHEST) if hit else 0.0
            out.point[b, g, ray, 2] = clipped(ground + z + nearest * up, FARTHEST) if hit else 0.0

    @staticmethod
    def as_object(readings: Readings, seen: Seen) -> LidarPointCloud:
        """Return points, hits and rays as lists."""
        hits = readings["hit"] != 0
        points = np.where(hits[:, None], readings["point"], np.inf)
        ego = seen.ego_vehicle_state
        x, y, ground = ego.position
        origin = np.array([x, y, ground + ego.bounding_box.height + ABOVE_ROOF])
        return list(points), hits.tolist(), [(origin, ray) for ray in readings["ray"].astype(np.float64)]


@kernel
def _distance_to_box(x: float, y: float, z: float, dx: float, dy: float, dz: float, box: Floats) -> float:
    """Return how far along a ray a box is met, infinite if it is not.

    The box is x, y of its centre, cosine and sine of its heading, length, width and height.
    """
    px, py = x - box[0], y - box[1]
    near_along, far_along = slab(
        px * box[2] + py * box[3], dx * box[2] + dy * box[3], -0.5 * box[4], 0.5 * box[4]
    )
    near_across, far_across = slab(
        py * box[2] - px * box[3], dy * box[2] - dx * box[3], -0.5 * box[5], 0.5 * box[5]
    )
    near_up, far_up = slab(z, dz, 0.0, box[6])
    near, far = max(near_along, near_across, near_up), min(far_along, far_across, far_up)
    return near if 0.0 <= near <= far else np.inf


@kernel
def _boxes_within(vehicles: VehicleStates, b: int, own: int, reach: float, boxes: Floats) -> int:
    """List the boxes of the other vehicles of one simulation within reach; return how many."""
    count = 0
    for v in range(vehicles.alive.shape[1]):
        if not meets(vehicles, b, own, v):
            continue
        long = clipped_above(vehicles.length[b, v], LARGEST_BOX)
        wide = clipped_above(vehicles.width[b, v], LARGEST_BOX)
        x, y = vehicles.position[b, v, 0], vehicles.position[b, v, 1]
        apart = math.hypot(x - vehicles.position[b, own, 0], y - vehicles.position[b, own, 1])
        if apart <= reach + 0.5 * math.hypot(long, wide):
            direction = clipped(vehicles.heading[b, v], math.pi)
            boxes[count, 0], boxes[count, 1] = x, y
            boxes[count, 2], boxes[count, 3] = math.cos(direction), math.sin(direction)
            boxes[count, 4], boxes[count, 5] = long, wide
            boxes[count, 6] = vehicle_height(vehicles.kind[b, v])
            count += 1
    return count
