"""The feature `lane_ways`: centrelines of the own lane and of those beside it, from behind the vehicle on."""

from __future__ import annotations

import math

import numpy as np

from smarts.arrays import Floats
from smarts.geometry.compiling import kernel
from smarts.observations.feature import Feature
from smarts.observations.way_ahead import SPACING, write_way
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.lane_ways import place_on_lane, row_of
from smarts.types.interface import Field
from smarts.types.world import State

LANE_WAYS = "lane_ways"
"""Name of the field."""
BEHIND = 10
"""Points behind the vehicle: 20 m."""
POINTS = 52
"""Points of each lane, the one beside the vehicle and 82 m ahead among them."""


class LaneWays(Feature):
    """Points x, y, heading of the own lane, the left and the right one, every 2 m from 20 m behind on.

    The ways are those of the route, elsewhere the straightest ones; beyond the ends of roads, and before the
    beginning of the lane beside the vehicle, they are straight, whatever road leads there. Zeros stand for no
    lane of the same kind, and beside a lane in a junction.
    """

    in_vector = False

    def fields(self) -> tuple[Field, ...]:
        """Return the array of the ways."""
        meaning = "x, y [m], heading [rad] along the own, left, right lane"
        return (Field(LANE_WAYS, (3, POINTS, 3), np.float64, -np.inf, np.inf, "", meaning),)

    @staticmethod
    @kernel
    def write(state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: Floats) -> None:
        """Write an agent's ways, shape (3, POINTS, 3); see `Feature`."""
        vehicles, slot = state.vehicles, state.agents.slot[b, a]
        here = vehicles.lane[b, slot]
        out[:] = 0.0
        if here < 0:
            own, heading = out[0], vehicles.heading[b, slot]
            own[0, 0] = vehicles.position[b, slot, 0] - BEHIND * SPACING * math.cos(heading)
            own[0, 1] = vehicles.position[b, slot, 1] - BEHIND * SPACING * math.sin(heading)
            own[0, 2] = heading
            _extend(own, 1)
            return
        lane = roads.lane_base[state.map[b]] + here
        _write_lane(state, roads, routes, b, a, lane, out[0])
        for side in range(1, 3):
            other = int(roads.lane_left[lane] if side == 1 else roads.lane_right[lane])
            if other < 0 or roads.lane_kind[other] != roads.lane_kind[lane] or roads.lane_inside[lane]:
                continue
            _write_lane(state, roads, routes, b, a, other, out[side])


@kernel
def _write_lane(
    state: State, roads: Roads, routes: RouteTable, b: int, a: int, lane: int, out: Floats
) -> None:
    """Write the way along a lane, numbered across all maps."""
    vehicles, m, slot = state.vehicles, state.map[b], state.agents.slot[b, a]
    first_lane, route = roads.lane_base[m], routes.number[b, a]
    x, y = vehicles.position[b, slot]
    s, _ = place_on_lane(roads, lane, x, y, vehicles.height[b, slot])
    row = row_of(routes, m, route, lane, first_lane, state.agents.route_progress[b, a])
    count = write_way(state, roads, routes, b, row, s - BEHIND * SPACING, route, out).points
    _extend(out, count)


@kernel
def _extend(points: Floats, count: int) -> None:
    """Write the points from `count` on, straight ahead of the last one before."""
    for i in range(count, len(points)):
        points[i, 0] = points[i - 1, 0] + SPACING * math.cos(points[i - 1, 2])
        points[i, 1] = points[i - 1, 1] + SPACING * math.sin(points[i - 1, 2])
        points[i, 2] = points[i - 1, 2]
