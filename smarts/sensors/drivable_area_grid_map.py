"""Where around the agent's vehicle there is road."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from smarts.agents.options import DrivableAreaGridMap
from smarts.arrays import Bools, Ints, Pixels
from smarts.geometry.binding import bind
from smarts.geometry.compiling import kernel
from smarts.roads.scene import Scene
from smarts.sensors.grid_map import GridMap, GridOut, grid_fields, grid_map, viewer
from smarts.sensors.protocol import Readings, Seen
from smarts.sensors.road_raster import ROAD, RoadRaster, paint_road, road_raster
from smarts.types.agent_states import AgentStates
from smarts.types.interface import Field
from smarts.types.vehicles import VehicleStates


@dataclass(frozen=True)
class DrivableArea:
    """A view from above: lanes for motor vehicles and junctions."""

    option: DrivableAreaGridMap = field(default_factory=DrivableAreaGridMap)

    def fields(self) -> tuple[Field, ...]:
        """Return what is reported."""
        meaning = "1 on the road; the vehicle in the middle, its front towards row 0"
        return grid_fields(self.option.height, self.option.width, 1, 1, meaning)

    def bind(self, scene: Scene, agent_ids: Ints, out: Readings) -> Callable[[Bools], object]:
        """Return the function that writes the readings of the agents in its mask."""
        world, resolution = scene.world, float(self.option.resolution)
        is_road = (np.arange(16, dtype=np.uint8) & ROAD)[:, None]
        state = world.agents, world.vehicles, world.map, road_raster(scene.atlas)
        return bind(_observe, *state, agent_ids, resolution, is_road, GridOut(**out))

    @staticmethod
    def as_object(readings: Readings, seen: Seen) -> GridMap:
        """Return the picture."""
        return grid_map(readings, seen)


@kernel
def _observe(
    agents: AgentStates,
    vehicles: VehicleStates,
    maps: Ints,
    raster: RoadRaster,
    agent_ids: Ints,
    resolution: float,
    is_road: Pixels,
    out: GridOut,
    observe_mask: Bools,
) -> None:
    for b in range(observe_mask.shape[0]):
        for g in range(observe_mask.shape[1]):
            if observe_mask[b, g]:
                x, y, heading = viewer(vehicles, b, agents.slot[b, agent_ids[g]])
                paint_road(raster, maps[b], x, y, heading, resolution, is_road, out.data[b, g])
                out.resolution[b, g] = resolution
