"""The feature `heading_errors`, and the search for the lane ahead that others share."""

from __future__ import annotations

import math
from collections.abc import Callable

from numpy.typing import NDArray

from smarts.arrays import Bools, Ints, Singles
from smarts.geometry.binding import bind
from smarts.geometry.compiling import kernel
from smarts.observations.feature import Feature
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.kernels import centre_at, find_row, lane_length
from smarts.types.agent_states import AgentStates
from smarts.types.vehicles import VehicleStates

WAYPOINTS = 20
SPACING = 1.0
"""Between waypoints [m]."""


class HeadingErrors(Feature):
    """Sines of how far the next 20 waypoints, a metre apart, point to the left of the heading.

    The waypoints are those of the lane that the vehicle steers for, along the route; zeros without a lane.
    """

    size = WAYPOINTS

    def bind(self, *out: NDArray) -> Callable[[Bools], object]:
        """Return the function that observes."""
        scene = self.context.scene
        ways = scene.atlas.roads, scene.routes.current, scene.routes.number, scene.world.map
        return bind(_observe, scene.world.agents, scene.world.vehicles, *ways, self.context.agent_ids, *out)


@kernel
def row_ahead(
    roads: Roads, table: RouteTable, base: int, free: int, route: int, lane: int, done: float
) -> int:
    """Return the table's row of a lane on the route, or, off the route, in the corridor without one."""
    row = -1
    if route >= 0:
        row = find_row(table, table.free + route, base + lane, done)
    return row if row >= 0 else table.start[free] + lane


@kernel
def _write(roads: Roads, table: RouteTable, row: int, s: float, heading: float, out: Singles) -> None:
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


@kernel
def _observe(
    agents: AgentStates,
    vehicles: VehicleStates,
    roads: Roads,
    table: RouteTable,
    routes: Ints,
    maps: Ints,
    agent_ids: Ints,
    out: Singles,
    observe_mask: Bools,
) -> None:
    for b in range(observe_mask.shape[0]):
        base = roads.lane_base[maps[b]]
        for g in range(observe_mask.shape[1]):
            if not observe_mask[b, g]:
                continue
            a = agent_ids[g]
            own, route, done = agents.slot[b, a], routes[b, a], agents.route_progress[b, a]
            lane, target = vehicles.lane[b, own], agents.target_lane[b, a]
            out[b, g] = 0.0
            if lane < 0:
                continue
            s = vehicles.lane_position[b, own]
            row = row_ahead(roads, table, base, maps[b], route, lane, done)
            if target >= 0 and target != lane:
                other = row_ahead(roads, table, base, maps[b], route, target, done)
                # Only beside the own lane: a target on another road is one that was passed.
                if table.group[other] == table.group[row]:
                    own_end = lane_length(roads, base + lane)
                    target_end = lane_length(roads, base + target)
                    row, s = other, s * target_end / own_end
            _write(roads, table, row, s, vehicles.heading[b, own], out[b, g])
