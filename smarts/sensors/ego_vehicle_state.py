"""The agent's own vehicle."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from smarts.geometry.compiling import kernel
from smarts.roads.scene import Scene
from smarts.sensors.bounds import (
    FARTHEST,
    FASTEST,
    FASTEST_TURN,
    LARGEST_BOX,
    MOST,
    clipped,
    clipped_above,
)
from smarts.sensors.heights import vehicle_height
from smarts.types.interface import Field

Bools = NDArray[np.bool_]
Bytes = NDArray[np.int8]
Ints = NDArray[np.int32]
Floats = NDArray[np.float64]
Singles = NDArray[np.float32]


@dataclass(frozen=True)
class EgoVehicleState:
    """Pose, size and motion of the agent's vehicle, and the lane that it is on."""

    def fields(self) -> tuple[Field, ...]:
        """Return what is reported."""
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

    def observe(self, scene: Scene, agent_ids: Ints, observe_mask: Bools, out: Mapping[str, NDArray]) -> None:
        """Write the readings of the wanted agents."""
        world, vehicles, roads = scene.world, scene.world.vehicles, scene.atlas.roads
        _observe(
            agent_ids,
            observe_mask,
            world.agents.slot,
            world.agents.steering,
            world.agents.distance_travelled,
            world.map,
            vehicles.kind,
            vehicles.position,
            vehicles.heading,
            vehicles.speed,
            vehicles.lateral_speed,
            vehicles.yaw_rate,
            vehicles.length,
            vehicles.width,
            vehicles.lane,
            roads.lane_base,
            roads.lane_index,
            out["position"],
            out["bounding_box"],
            out["heading"],
            out["speed"],
            out["steering"],
            out["yaw_rate"],
            out["linear_velocity"],
            out["lane"],
            out["lane_index"],
            out["distance_travelled"],
        )


@kernel
def _observe(
    agent_ids: Ints,
    observe_mask: Bools,
    slots: Ints,
    steering: Floats,
    distance_travelled: Floats,
    maps: Ints,
    kind: Bytes,
    position: Floats,
    heading: Floats,
    speed: Floats,
    lateral_speed: Floats,
    yaw_rate: Floats,
    length: Floats,
    width: Floats,
    lane: Ints,
    lane_base: Ints,
    lane_index: Ints,
    position_out: Floats,
    box_out: Singles,
    heading_out: Singles,
    speed_out: Singles,
    steering_out: Singles,
    yaw_rate_out: Singles,
    velocity_out: Singles,
    lane_out: Ints,
    lane_index_out: Ints,
    travelled_out: Singles,
) -> None:
    for b in range(observe_mask.shape[0]):
        for g in range(observe_mask.shape[1]):
            if not observe_mask[b, g]:
                continue
            a = agent_ids[g]
            v = slots[b, a]
            position_out[b, g, 0] = clipped(position[b, v, 0], FARTHEST)
            position_out[b, g, 1] = clipped(position[b, v, 1], FARTHEST)
            position_out[b, g, 2] = 0.0
            box_out[b, g, 0] = clipped_above(length[b, v], LARGEST_BOX)
            box_out[b, g, 1] = clipped_above(width[b, v], LARGEST_BOX)
            box_out[b, g, 2] = vehicle_height(kind[b, v])
            heading_out[b, g] = clipped(heading[b, v], math.pi)
            forward, aside = clipped(speed[b, v], FASTEST), clipped(lateral_speed[b, v], FASTEST)
            cosine, sine = math.cos(heading_out[b, g]), math.sin(heading_out[b, g])
            speed_out[b, g] = forward
            steering_out[b, g] = clipped(steering[b, a], math.pi)
            yaw_rate_out[b, g] = clipped(yaw_rate[b, v], FASTEST_TURN)
            velocity_out[b, g, 0] = forward * cosine - aside * sine
            velocity_out[b, g, 1] = forward * sine + aside * cosine
            lane_out[b, g] = lane[b, v]
            lane_index_out[b, g] = lane_index[lane_base[maps[b]] + lane[b, v]] if lane[b, v] >= 0 else 0
            travelled_out[b, g] = clipped_above(distance_travelled[b, a], FARTHEST)
