"""Where around the agent's vehicle there is road."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from smarts.agents.options import DrivableAreaGridMap
from smarts.geometry.compiling import kernel
from smarts.geometry.raster import cut_view
from smarts.roads.scene import Scene
from smarts.sensors.bounds import FARTHEST, clipped
from smarts.sensors.road_raster import ROAD, RoadRaster, road_raster
from smarts.types.interface import Field

Bools = NDArray[np.bool_]
Ints = NDArray[np.int32]
Floats = NDArray[np.float64]
Pixels = NDArray[np.uint8]


@dataclass(frozen=True)
class DrivableArea:
    """A view from above: lanes for motor vehicles and junctions."""

    option: DrivableAreaGridMap = field(default_factory=DrivableAreaGridMap)

    def fields(self) -> tuple[Field, ...]:
        """Return what is reported."""
        shape = (self.option.height, self.option.width, 1)
        meaning = "1 on the road; the vehicle in the middle, its front towards row 0"
        return (
            Field("data", shape, np.uint8, 0, 1, "", meaning),
            Field("resolution", (), np.float32, 0, FARTHEST, "m", "side of a pixel"),
        )

    def observe(self, scene: Scene, agent_ids: Ints, observe_mask: Bools, out: Mapping[str, NDArray]) -> None:
        """Write the readings of the wanted agents."""
        world = scene.world
        _observe(
            agent_ids,
            observe_mask,
            world.agents.slot,
            world.map,
            world.vehicles.position,
            world.vehicles.heading,
            road_raster(scene.atlas),
            self.option.resolution,
            out["data"],
        )
        out["resolution"][observe_mask] = self.option.resolution


@kernel
def _observe(
    agent_ids: Ints,
    observe_mask: Bools,
    slots: Ints,
    maps: Ints,
    position: Floats,
    heading: Floats,
    raster: RoadRaster,
    resolution: float,
    views: Pixels,
) -> None:
    for b in range(observe_mask.shape[0]):
        for g in range(observe_mask.shape[1]):
            if not observe_mask[b, g]:
                continue
            v, m = slots[b, agent_ids[g]], maps[b]
            cut_view(
                raster.cells,
                raster.first[m],
                raster.shape[m, 0],
                raster.shape[m, 1],
                raster.origin[m, 0],
                raster.origin[m, 1],
                raster.size[m],
                clipped(position[b, v, 0], FARTHEST),
                clipped(position[b, v, 1], FARTHEST),
                clipped(heading[b, v], math.pi),
                resolution,
                ROAD,
                views[b, g, :, :, 0],
            )
