"""The via points of the agent's mission."""

from __future__ import annotations

from collections import namedtuple
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import numpy as np

from smarts.agents.options import Vias as ViaOption
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.scene import Scene
from smarts.sensors.bounds import FARTHEST, FASTEST, MOST, clipped, clipped_above
from smarts.sensors.nearest import keep_nearest
from smarts.sensors.protocol import KernelSensor, Readings, Seen
from smarts.types.interface import Field
from smarts.types.world import State


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


_Out = namedtuple("_Out", "count position lane lane_index required_speed hit")
"""Shape (B, G, ...), K points each."""


@dataclass(frozen=True)
class ViaPoints(KernelSensor):
    """The via points near the vehicle, nearest first, including points that it has passed."""

    option: ViaOption = field(default_factory=ViaOption)
    arrays: ClassVar[type] = _Out

    def fields(self) -> tuple[Field, ...]:
        """Return the fields."""
        k = self.option.most
        return (
            Field("count", (), np.int32, 0, k, "", "how many points follow; the entries after them are 0"),
            Field("position", (k, 2), np.float64, -FARTHEST, FARTHEST, "m", ""),
            Field("lane", (k,), np.int32, -1, MOST, "", "number in the map"),
            Field("lane_index", (k,), np.int32, 0, MOST, "", "place across the road, 0 is the rightmost"),
            Field("required_speed", (k,), np.float32, 0, FASTEST, "m/s", "to pass it at"),
            Field("hit", (k,), np.int8, 0, 1, "", "1 if it has been passed, in laps in this one"),
        )

    def known(self, scene: Scene) -> tuple[Any, ...]:
        """Return what the kernel needs besides the state."""
        most = self.option.most
        return ((float(self.option.acquisition_range), np.empty(most, np.int32), np.empty(most)),)

    @staticmethod
    @kernel
    def write(
        state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: _Out, known: Any
    ) -> None:
        """Write an agent's readings; see `KernelSensor`."""
        reach, order, far = known
        vehicles, missions, agents = state.vehicles, state.missions, state.agents
        count = 0
        v = agents.slot[b, a]
        for via in range(missions.via_count[b, a]):
            dx = missions.via_position[b, a, via, 0] - vehicles.position[b, v, 0]
            dy = missions.via_position[b, a, via, 1] - vehicles.position[b, v, 1]
            square = dx * dx + dy * dy
            if square <= reach * reach:
                count = keep_nearest(order, far, count, via, square)
        out.count[b, g] = count
        for k in range(count):
            via = order[k]
            out.position[b, g, k, 0] = clipped(missions.via_position[b, a, via, 0], FARTHEST)
            out.position[b, g, k, 1] = clipped(missions.via_position[b, a, via, 1], FARTHEST)
            lane = missions.via_lane[b, a, via]
            out.lane[b, g, k] = lane
            index = roads.lane_index[roads.lane_base[state.map[b]] + lane] if lane >= 0 else 0
            out.lane_index[b, g, k] = index
            out.required_speed[b, g, k] = clipped_above(missions.via_speed[b, a, via], FASTEST)
            out.hit[b, g, k] = agents.via_hit[b, a, via]
        out.position[b, g, count:] = 0.0
        out.lane[b, g, count:] = 0
        out.lane_index[b, g, count:] = 0
        out.required_speed[b, g, count:] = 0.0
        out.hit[b, g, count:] = 0

    @staticmethod
    def as_object(readings: Readings, seen: Seen) -> Vias:
        """Return the points."""
        return Vias(
            tuple(
                ViaPoint(
                    position=(float(readings["position"][k, 0]), float(readings["position"][k, 1])),
                    lane_index=int(readings["lane_index"][k]),
                    road_id=seen.lane_ids(int(readings["lane"][k]))[0],
                    required_speed=float(readings["required_speed"][k]),
                    hit=bool(readings["hit"][k]),
                )
                for k in range(int(readings["count"]))
            )
        )
