"""The feature `junction_ahead`."""

from __future__ import annotations

import numpy as np

from smarts.arrays import Singles
from smarts.geometry.compiling import kernel
from smarts.observations.feature import Feature
from smarts.observations.scales import SIGHT, compressed
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.kernels import lane_length
from smarts.roads.lane_ways import next_row, row_of
from smarts.types.world import State


@kernel
def distance_to_junction(state: State, roads: Roads, routes: RouteTable, b: int, a: int) -> float:
    """Return the distance from an agent's front bumper to the junction ahead along its lanes [m].

    It is 0 inside a junction, infinite without a lane, and without a junction within `SIGHT`.
    """
    vehicles, m, slot = state.vehicles, state.map[b], state.agents.slot[b, a]
    base, lane = roads.lane_base[m], vehicles.lane[b, slot]
    if lane < 0:
        return np.inf
    row = row_of(routes, m, routes.number[b, a], base + lane, base, state.agents.route_progress[b, a])
    begin = -vehicles.lane_position[b, slot] - 0.5 * vehicles.length[b, slot]
    while row >= 0 and begin <= SIGHT:
        lane = int(routes.lane[row])
        if roads.lane_inside[lane]:
            return max(0.0, begin)
        begin += lane_length(roads, lane)
        row = next_row(roads, routes, m, row, base)
    return np.inf


class JunctionAhead(Feature):
    """Distance from the front bumper to the junction ahead, compressed.

    0 inside a junction, 1 without one within 100 m.
    """

    @staticmethod
    @kernel
    def write(state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: Singles) -> None:
        """Write an agent's numbers; see `Feature`."""
        out[0] = compressed(distance_to_junction(state, roads, routes, b, a), SIGHT)
