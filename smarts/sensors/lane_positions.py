"""Where along and across its lane the agent's vehicle is."""

from __future__ import annotations

from collections import namedtuple
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from smarts.agents.options import LanePositions
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.sensors.bounds import FARTHEST, clipped
from smarts.sensors.protocol import KernelSensor, Readings, Seen, triple
from smarts.types.coordinates import RefLinePoint
from smarts.types.interface import Field
from smarts.types.world import State

_Out = namedtuple("_Out", "lane_position")


@dataclass(frozen=True)
class LanePosition(KernelSensor):
    """The place in the lane as s, t, h: along the centreline, to its left, above the surface."""

    option: LanePositions = field(default_factory=LanePositions)
    arrays: ClassVar[type] = _Out

    def fields(self) -> tuple[Field, ...]:
        """Return the fields."""
        meaning = "along the lane from its begin, to the left of its centreline, above it (always 0)"
        return (Field("lane_position", (3,), np.float32, -FARTHEST, FARTHEST, "m", meaning),)

    @staticmethod
    @kernel
    def write(state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: _Out) -> None:
        """Write an agent's readings; see `KernelSensor`."""
        vehicles, v = state.vehicles, state.agents.slot[b, a]
        out.lane_position[b, g, 0] = clipped(vehicles.lane_position[b, v], FARTHEST)
        out.lane_position[b, g, 1] = clipped(vehicles.lane_offset[b, v], FARTHEST)
        out.lane_position[b, g, 2] = 0.0

    @staticmethod
    def as_object(readings: Readings, seen: Seen) -> RefLinePoint:
        """Return the place."""
        return RefLinePoint(*triple(readings["lane_position"]))
