"""The feature `light`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools, Bytes, Ints, Singles
from smarts.geometry.binding import bind
from smarts.geometry.compiling import kernel
from smarts.observations.feature import Feature
from smarts.observations.heading_errors import row_ahead
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.lights import light_ahead
from smarts.types.agent_states import AgentStates
from smarts.types.vehicles import VehicleStates

LIGHTS = np.array([0.0, -1.0, -0.5, 1.0])
"""The number of each `Signal`."""


class Light(Feature):
    """The light at the end of the lane, for the way along the route: -1 stop, -0.5 caution, 1 go, 0 none."""

    def bind(self, *out: NDArray) -> Callable[[Bools], object]:
        """Return the function that observes."""
        scene, world = self.context.scene, self.context.scene.world
        ways = scene.atlas.roads, scene.routes.current, scene.routes.number, world.map
        return bind(
            _observe, world.agents, world.vehicles, *ways, world.signals, self.context.agent_ids, *out
        )


@kernel
def _observe(
    agents: AgentStates,
    vehicles: VehicleStates,
    roads: Roads,
    table: RouteTable,
    routes: Ints,
    maps: Ints,
    signals: Bytes,
    agent_ids: Ints,
    out: Singles,
    observe_mask: Bools,
) -> None:
    for b in range(observe_mask.shape[0]):
        base, free = roads.lane_base[maps[b]], table.start[maps[b]]
        for g in range(observe_mask.shape[1]):
            if not observe_mask[b, g]:
                continue
            a = agent_ids[g]
            lane, done = vehicles.lane[b, agents.slot[b, a]], agents.route_progress[b, a]
            out[b, g, 0] = 0.0
            if lane >= 0:
                row = row_ahead(roads, table, base, maps[b], routes[b, a], lane, done)
                out[b, g, 0] = LIGHTS[light_ahead(table, row, base, free, signals[b])]
