"""Grid of the drivable area around the agent's vehicle."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from smarts.agents.options import DrivableAreaGridMap
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.scene import Scene
from smarts.sensors.grid_map import GridOut, PictureSensor, grid_fields, viewer
from smarts.sensors.road_raster import ROAD, paint_road, road_raster
from smarts.types.interface import Field
from smarts.types.world import State


@dataclass(frozen=True)
class DrivableArea(PictureSensor):
    """A view from above: lanes for motor vehicles and junctions."""

    option: DrivableAreaGridMap = field(default_factory=DrivableAreaGridMap)

    def fields(self) -> tuple[Field, ...]:
        """Return the fields."""
        meaning = "1 on the road; the vehicle in the middle, its front towards row 0"
        return grid_fields(self.option.height, self.option.width, 1, 1, meaning)

    def known(self, scene: Scene) -> tuple[Any, ...]:
        """Return what the kernel needs besides the state."""
        is_road = (np.arange(16, dtype=np.uint8) & ROAD)[:, None]
        return ((float(self.option.resolution), is_road, road_raster(scene.atlas)),)

    @staticmethod
    @kernel
    def write(
        state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: GridOut, known: Any
    ) -> None:
        """Write an agent's readings; see `KernelSensor`."""
        resolution, is_road, raster = known
        x, y, heading = viewer(state.vehicles, b, state.agents.slot[b, a])
        paint_road(raster, state.map[b], x, y, heading, resolution, is_road, out.data[b, g])
        out.resolution[b, g] = resolution
