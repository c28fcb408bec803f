"""The other vehicles around the agent's."""

from __future__ import annotations

import math
from collections import namedtuple
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import numpy as np

from smarts.agents.options import NeighborhoodVehicles
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.scene import Scene
from smarts.sensors.bounds import FARTHEST, FASTEST, LARGEST_BOX, MOST, clipped, clipped_above
from smarts.sensors.heights import vehicle_height
from smarts.sensors.nearest import nearest_vehicles
from smarts.sensors.protocol import KernelSensor, Readings, Seen, Triple
from smarts.types.coordinates import Dimensions, Heading, RefLinePoint
from smarts.types.interface import Field
from smarts.types.world import State


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
    """Id of the road that the vehicle is on, or that is nearest; "" if there is none."""
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


_Out = namedtuple(
    "_Out", "count slot generation position bounding_box heading speed lane lane_index lane_position"
)
"""Shape (B, G, ...), K vehicles each."""


@dataclass(frozen=True)
class NeighborhoodVehicleStates(KernelSensor):
    """The nearest other vehicles, nearest first; of vehicles equally far the one of the lower slot."""

    option: NeighborhoodVehicles = field(default_factory=NeighborhoodVehicles)
    arrays: ClassVar[type] = _Out

    def fields(self) -> tuple[Field, ...]:
        """Return the fields."""
        k = self.option.most
        return (
            Field("count", (), np.int32, 0, k, "", "how many vehicles follow; the entries after them are 0"),
            Field("slot", (k,), np.int32, 0, MOST, "", "the vehicle's place in the world's arrays"),
            Field("generation", (k,), np.int32, 0, MOST, "", "with the slot, the vehicle's identity"),
            Field("position", (k, 3), np.float64, -FARTHEST, FARTHEST, "m", "centre of the footprint"),
            Field("bounding_box", (k, 3), np.float32, 0, LARGEST_BOX, "m", "length, width, height"),
            Field("heading", (k,), np.float32, -np.pi, np.pi, "rad", "counter-clockwise from +x"),
            Field("speed", (k,), np.float32, -FASTEST, FASTEST, "m/s", "along the heading"),
            Field("lane", (k,), np.int32, -1, MOST, "", "number in the map, -1 if there is none"),
            Field("lane_index", (k,), np.int32, 0, MOST, "", "place across the road, 0 is the rightmost"),
            Field("lane_position", (k, 3), np.float32, -FARTHEST, FARTHEST, "m", "along, left of, above it"),
        )

    def known(self, scene: Scene) -> tuple[Any, ...]:
        """Return what the kernel needs besides the state."""
        radius, most = self.option.radius, self.option.most
        reach = math.inf if radius is None else float(radius)
        return ((reach, np.empty(most, np.int32), np.empty(most)),)

    @staticmethod
    @kernel
    def write(
        state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: _Out, known: Any
    ) -> None:
        """Write an agent's readings; see `KernelSensor`."""
        radius, found, squares = known
        vehicles, own = state.vehicles, state.agents.slot[b, a]
        count = nearest_vehicles(vehicles, b, own, radius, found, squares)
        out.count[b, g] = count
        _clear(out, b, g, count)
        for k in range(count):
            v = found[k]
            out.slot[b, g, k] = v
            out.generation[b, g, k] = vehicles.generation[b, v]
            out.position[b, g, k, 0] = clipped(vehicles.position[b, v, 0], FARTHEST)
            out.position[b, g, k, 1] = clipped(vehicles.position[b, v, 1], FARTHEST)
            out.position[b, g, k, 2] = clipped(vehicles.height[b, v], FARTHEST)
            out.bounding_box[b, g, k, 0] = clipped_above(vehicles.length[b, v], LARGEST_BOX)
            out.bounding_box[b, g, k, 1] = clipped_above(vehicles.width[b, v], LARGEST_BOX)
            out.bounding_box[b, g, k, 2] = vehicle_height(vehicles.kind[b, v])
            out.heading[b, g, k] = clipped(vehicles.heading[b, v], math.pi)
            out.speed[b, g, k] = clipped(vehicles.speed[b, v], FASTEST)
            lane = vehicles.lane[b, v]
            out.lane[b, g, k] = lane
            index = roads.lane_index[roads.lane_base[state.map[b]] + lane] if lane >= 0 else 0
            out.lane_index[b, g, k] = index
            out.lane_position[b, g, k, 0] = clipped(vehicles.lane_position[b, v], FARTHEST)
            out.lane_position[b, g, k, 1] = clipped(vehicles.lane_offset[b, v], FARTHEST)
            out.lane_position[b, g, k, 2] = 0.0

    @staticmethod
    def as_object(readings: Readings, seen: Seen) -> tuple[VehicleObservation, ...]:
        """Return the vehicles, nearest first."""
        # One conversion of each array: single numbers of arrays are slow.
        count = int(readings["count"])
        each = {name: array[:count].tolist() for name, array in readings.items() if name != "count"}
        return tuple(
            VehicleObservation(
                name,
                tuple(each["position"][k]),
                Dimensions(*each["bounding_box"][k]),
                Heading(each["heading"][k]),
                each["speed"][k],
                *seen.lane_ids(each["lane"][k]),
                each["lane_index"][k],
                RefLinePoint(*each["lane_position"][k]),
            )
            for k, name in enumerate(seen.neighbors)
        )


@kernel
def _clear(out: _Out, b: int, g: int, first: int) -> None:
    out.slot[b, g, first:], out.generation[b, g, first:] = 0, 0
    out.heading[b, g, first:], out.speed[b, g, first:] = 0.0, 0.0
    out.lane[b, g, first:], out.lane_index[b, g, first:] = 0, 0
    out.position[b, g, first:] = 0.0
    out.bounding_box[b, g, first:] = 0.0
    out.lane_position[b, g, first:] = 0.0
