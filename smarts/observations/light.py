"""The feature `light`."""

from __future__ import annotations

import numpy as np

from smarts.arrays import Singles
from smarts.geometry.compiling import kernel
from smarts.observations.feature import Feature
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.lane_ways import row_of
from smarts.roads.lights import light_ahead
from smarts.types.world import State

LIGHTS = np.array([0.0, -1.0, -0.5, 1.0])
"""The number of each `Signal`."""


class Light(Feature):
    """The light at the end of the lane, for the way along the route: -1 stop, -0.5 caution, 1 go, 0 none."""

    @staticmethod
    @kernel
    def write(state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: Singles) -> None:
        """Write an agent's numbers; see `Feature`."""
        m = state.map[b]
        base, free = roads.lane_base[m], routes.start[m]
        lane, done = state.vehicles.lane[b, state.agents.slot[b, a]], state.agents.route_progress[b, a]
        out[0] = 0.0
        if lane >= 0:
            row = row_of(routes, m, routes.number[b, a], base + lane, base, done)
            out[0] = LIGHTS[light_ahead(routes, row, base, free, state.signals[b])]
