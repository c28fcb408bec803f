"""Where around the agent's vehicle there are vehicles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from smarts.agents.options import OGM
from smarts.arrays import Bools, Ints
from smarts.geometry.binding import bind
from smarts.geometry.compiling import kernel
from smarts.roads.scene import Scene
from smarts.sensors.grid_map import GridMap, GridOut, grid_fields, grid_map, paint_vehicle, viewer
from smarts.sensors.protocol import Readings, Seen
from smarts.types.agent_states import AgentStates
from smarts.types.interface import Field
from smarts.types.vehicles import VehicleStates


@dataclass(frozen=True)
class OccupancyGrid:
    """A view from above: the footprints of all vehicles, the agent's own included."""

    option: OGM = field(default_factory=OGM)

    def fields(self) -> tuple[Field, ...]:
        """Return what is reported."""
        meaning = "1 on a vehicle; the own vehicle in the middle, its front towards row 0"
        return grid_fields(self.option.height, self.option.width, 1, 1, meaning)

    def bind(self, scene: Scene, agent_ids: Ints, out: Readings) -> Callable[[Bools], object]:
        """Return the function that writes the readings of the agents in its mask."""
        world, resolution = scene.world, float(self.option.resolution)
        return bind(_observe, world.agents, world.vehicles, agent_ids, resolution, GridOut(**out))

    @staticmethod
    def as_object(readings: Readings, seen: Seen) -> GridMap:
        """Return the picture."""
        return grid_map(readings, seen)


@kernel
def _observe(
    agents: AgentStates,
    vehicles: VehicleStates,
    agent_ids: Ints,
    resolution: float,
    out: GridOut,
    observe_mask: Bools,
) -> None:
    taken = np.ones(1, np.uint8)
    for b in range(observe_mask.shape[0]):
        for g in range(observe_mask.shape[1]):
            if not observe_mask[b, g]:
                continue
            x, y, heading = viewer(vehicles, b, agents.slot[b, agent_ids[g]])
            out.data[b, g] = 0
            for v in range(vehicles.alive.shape[1]):
                if vehicles.alive[b, v]:
                    paint_vehicle(vehicles, b, v, x, y, heading, resolution, taken, out.data[b, g])
            out.resolution[b, g] = resolution
