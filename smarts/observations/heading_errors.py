"""The feature `heading_errors`, and the search for the lane ahead that others share."""

from __future__ import annotations

import math

from smarts.arrays import Singles
from smarts.geometry.compiling import kernel
from smarts.observations.feature import Feature
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.kernels import centre_at, lane_length
from smarts.roads.lane_ways import row_of
from smarts.types.world import State

WAYPOINTS = 20
SPACING = 1.0
"""Between waypoints [m]."""


@kernel
def _write_sines(roads: Roads, table: RouteTable, row: int, s: float, heading: float, out: Singles) -> None:
    """Write the sines for waypoints from arc length `s` of the lane of `row` on.

    Behind the end of the route the last direction continues.
    """
    error = 0.0
    s += SPACING
    lane = table.lane[row]
    point, last = roads.point_start[lane], roads.point_start[lane + 1] - 2
    for i in range(WAYPOINTS):
        while s > lane_length(roads, lane) and table.onward_start[row + 1] > table.onward_start[row]:
            s -= lane_length(roads, lane)
            row = int(table.onward[table.onward_start[row]])
            lane = table.lane[row]
            point, last = roads.point_start[lane], roads.point_start[lane + 1] - 2
        if s <= lane_length(roads, lane):
            while point < last and roads.point_s[point + 1] <= s:
                point += 1
            error = math.sin(centre_at(roads, point, s)[2] - heading)
        out[i] = error
        s += SPACING


class HeadingErrors(Feature):
    """Sines of how far the next 20 waypoints, a metre apart, point to the left of the heading.

    The waypoints lie in the lane that the vehicle steers for, along the route; zeros without a lane.
    """

    size = WAYPOINTS

    @staticmethod
    @kernel
    def write(state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: Singles) -> None:
        """Write an agent's numbers; see `Feature`."""
        vehicles, m = state.vehicles, state.map[b]
        own, base, route = state.agents.slot[b, a], roads.lane_base[m], routes.number[b, a]
        done, target = state.agents.route_progress[b, a], state.agents.target_lane[b, a]
        lane, s = vehicles.lane[b, own], vehicles.lane_position[b, own]
        out[:] = 0.0
        if lane < 0:
            return
        row = row_of(routes, m, route, base + lane, base, done)
        if target >= 0 and target != lane:
            other = row_of(routes, m, route, base + target, base, done)
            # Only beside the own lane: a target on another road is one that was passed.
            if routes.group[other] == routes.group[row]:
                own_end = lane_length(roads, base + lane)
                target_end = lane_length(roads, base + target)
                row, s = other, s * target_end / own_end
        _write_sines(roads, routes, row, s, vehicles.heading[b, own], out)
