"""Occupancy grid around the agent's vehicle."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from smarts.agents.options import OGM
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.levels import meets
from smarts.roads.scene import Scene
from smarts.sensors.grid_map import GridOut, PictureSensor, grid_fields, paint_vehicle, viewer
from smarts.types.interface import Field
from smarts.types.world import State


@dataclass(frozen=True)
class OccupancyGrid(PictureSensor):
    """A view from above: the footprints of all vehicles, the agent's own included."""

    option: OGM = field(default_factory=OGM)

    def fields(self) -> tuple[Field, ...]:
        """Return the fields."""
        meaning = "1 on a vehicle; the own vehicle in the middle, its front towards row 0"
        return grid_fields(self.option.height, self.option.width, 1, 1, meaning)

    def known(self, scene: Scene) -> tuple[Any, ...]:
        """Return what the kernel needs besides the state."""
        return ((float(self.option.resolution), np.ones(1, np.uint8)),)

    @staticmethod
    @kernel
    def write(
        state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: GridOut, known: Any
    ) -> None:
        """Write an agent's readings; see `KernelSensor`."""
        resolution, occupied = known
        vehicles, own = state.vehicles, state.agents.slot[b, a]
        x, y, heading = viewer(vehicles, b, own)
        out.data[b, g] = 0
        for v in range(vehicles.alive.shape[1]):
            if v == own or meets(vehicles, b, own, v):
                paint_vehicle(vehicles, b, v, x, y, heading, resolution, occupied, out.data[b, g])
        out.resolution[b, g] = resolution
