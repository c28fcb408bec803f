"""Where around the agent's vehicle there are vehicles."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from smarts.agents.options import OGM
from smarts.geometry.compiling import kernel
from smarts.geometry.raster import paint_box, place_in_view
from smarts.roads.scene import Scene
from smarts.sensors.bounds import FARTHEST, LARGEST_BOX, clipped, clipped_above
from smarts.types.interface import Field

Bools = NDArray[np.bool_]
Ints = NDArray[np.int32]
Floats = NDArray[np.float64]
Pixels = NDArray[np.uint8]


@dataclass(frozen=True)
class OccupancyGrid:
    """A view from above: the footprints of all vehicles, the agent's own included."""

    option: OGM = field(default_factory=OGM)

    def fields(self) -> tuple[Field, ...]:
        """Return what is reported."""
        shape = (self.option.height, self.option.width, 1)
        meaning = "1 on a vehicle; the own vehicle in the middle, its front towards row 0"
        return (
            Field("data", shape, np.uint8, 0, 1, "", meaning),
            Field("resolution", (), np.float32, 0, FARTHEST, "m", "side of a pixel"),
        )

    def observe(self, scene: Scene, agent_ids: Ints, observe_mask: Bools, out: Mapping[str, NDArray]) -> None:
        """Write the readings of the wanted agents."""
        vehicles = scene.world.vehicles
        _observe(
            agent_ids,
            observe_mask,
            scene.world.agents.slot,
            vehicles.alive,
            vehicles.position,
            vehicles.heading,
            vehicles.length,
            vehicles.width,
            self.option.resolution,
            out["data"],
        )
        out["resolution"][observe_mask] = self.option.resolution


@kernel
def _observe(
    agent_ids: Ints,
    observe_mask: Bools,
    slots: Ints,
    alive: Bools,
    position: Floats,
    heading: Floats,
    length: Floats,
    width: Floats,
    resolution: float,
    views: Pixels,
) -> None:
    taken = np.ones(1, np.uint8)
    for b in range(observe_mask.shape[0]):
        for g in range(observe_mask.shape[1]):
            if not observe_mask[b, g]:
                continue
            own = slots[b, agent_ids[g]]
            views[b, g] = 0
            x, y = clipped(position[b, own, 0], FARTHEST), clipped(position[b, own, 1], FARTHEST)
            direction = clipped(heading[b, own], math.pi)
            for v in range(alive.shape[1]):
                if alive[b, v]:
                    ahead, aside = place_in_view(position[b, v, 0], position[b, v, 1], x, y, direction)
                    paint_box(
                        views[b, g],
                        resolution,
                        ahead,
                        aside,
                        clipped(heading[b, v], math.pi) - direction,
                        clipped_above(length[b, v], LARGEST_BOX),
                        clipped_above(width[b, v], LARGEST_BOX),
                        taken,
                    )
