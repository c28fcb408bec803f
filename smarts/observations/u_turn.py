"""The feature `u_turn`: the way along the own lane, and the way round into the opposite direction."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from smarts.arrays import Bools, Floats, Ints
from smarts.geometry.binding import bind
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import segment_at
from smarts.observations.feature import Feature
from smarts.observations.way_ahead import SPACING, gap_behind, write_way
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.curves import curve_into, pose_along, sharpest_bend, stations_of
from smarts.roads.kernels import centre_at, lane_length
from smarts.roads.lane_ways import place_on_lane, row_of
from smarts.roads.turning import is_footprint_over_road, is_opposite
from smarts.types.interface import Field
from smarts.types.world import State

POINTS = 32
"""Of each way."""
LAST = 11
"""Points of the way round that are in its last lane."""
LANE_WAY, TURN_WAY, TURN_STATE = "lane_way", "turn_way", "turn_state"
"""Names of the fields."""
SHARPEST = 0.25
"""Largest curvature of a way round that cars can steer [1/m]."""
LATERAL = 2.0
"""Lateral acceleration in the turn [m/s^2]."""
SPARE = 0.4
"""Added to the vehicle's width where the road has to be wide enough [m]."""


class UTurnWays(Feature):
    """Points x, y, heading of the way along the lane and of the way round into the other direction.

    `lane_way`: every 2 m. `turn_way`: along a curve into the nearest lane of the other direction that cars
    can steer into with their whole footprint on the road, and 20 m on in it; zeros where there is none.
    `turn_state`: speed in the turn [m/s], 0 where it cannot turn; gap to the next vehicle that comes in that
    lane [m], infinite for none; its speed [m/s].
    """

    in_vector = False

    def fields(self) -> tuple[Field, ...]:
        """Return the three arrays."""
        way = "x, y [m], heading [rad] of the way"
        inf = np.inf
        return (
            Field(LANE_WAY, (POINTS, 3), np.float64, -inf, inf, "", f"{way} along the lane"),
            Field(TURN_WAY, (POINTS, 3), np.float64, -inf, inf, "", f"{way} round"),
            Field(TURN_STATE, (3,), np.float64, 0.0, inf, "", "speed in the turn, oncoming gap and speed"),
        )

    def bind(self, *out: Floats) -> Callable[[Bools], object]:
        """Return the function that observes; see `Feature`."""
        scene = self.context.scene
        known = scene.world.state, scene.atlas.roads, scene.routes.current, self.context.agent_ids
        return bind(_observe, *known, *out)


@kernel
def _observe(
    state: State,
    roads: Roads,
    routes: RouteTable,
    agent_ids: Ints,
    lane_way: Floats,
    turn_way: Floats,
    turn_state: Floats,
    observe_mask: Bools,
) -> None:
    for b in range(observe_mask.shape[0]):
        for g in range(observe_mask.shape[1]):
            if observe_mask[b, g]:
                a = agent_ids[g]
                _write_lane_way(state, roads, routes, b, a, lane_way[b, g])
                _write_turn(state, roads, b, a, turn_way[b, g], turn_state[b, g])


@kernel
def _write_lane_way(state: State, roads: Roads, routes: RouteTable, b: int, a: int, out: Floats) -> None:
    """Write the way along the lane; where the road ends, straight on."""
    vehicles, m, slot = state.vehicles, state.map[b], state.agents.slot[b, a]
    lane, count = vehicles.lane[b, slot], 0
    if lane >= 0:
        base, route, hint = roads.lane_base[m], routes.number[b, a], state.agents.route_progress[b, a]
        row = row_of(routes, m, route, base + lane, base, hint)
        count = write_way(state, roads, routes, b, row, vehicles.lane_position[b, slot], route, out).points
    if count == 0:
        out[0, 0], out[0, 1] = vehicles.position[b, slot]
        out[0, 2], count = vehicles.heading[b, slot], 1
    _extend(out, count)


@kernel
def _extend(points: Floats, count: int) -> None:
    """Write the points from `count` on, straight ahead of the last one before."""
    for i in range(count, len(points)):
        points[i, 0] = points[i - 1, 0] + SPACING * math.cos(points[i - 1, 2])
        points[i, 1] = points[i - 1, 1] + SPACING * math.sin(points[i - 1, 2])
        points[i, 2] = points[i - 1, 2]


@kernel
def _write_turn(state: State, roads: Roads, b: int, a: int, way: Floats, turn: Floats) -> None:
    """Write the way round from where the vehicle is, and what comes in its last lane."""
    vehicles, m, slot = state.vehicles, state.map[b], state.agents.slot[b, a]
    way[:], turn[:] = 0.0, 0.0
    turn[1] = np.inf
    lane = vehicles.lane[b, slot]
    if lane < 0 or roads.lane_inside[roads.lane_base[m] + lane]:
        return
    begin = np.empty(3)
    begin[0], begin[1] = vehicles.position[b, slot]
    begin[2] = vehicles.heading[b, slot]
    back = int(roads.lane_twin[roads.lane_base[m] + lane])
    while back >= 0:
        s, _ = place_on_lane(roads, back, begin[0], begin[1])
        room = lane_length(roads, back) - s
        if s > 0.0 and room > SPACING and is_opposite(roads, begin[2], back, s):
            control = curve_into(roads, begin, back, s)
            bend = sharpest_bend(control, stations_of(control))
            length, width = vehicles.length[b, slot], vehicles.width[b, slot] + SPARE
            if bend <= SHARPEST and is_footprint_over_road(roads, m, control, length, width):
                turn[0] = math.sqrt(LATERAL / bend)
                _write_turn_way(roads, back, s, control, way)
                heading = way[len(way) - LAST, 2]
                turn[1], turn[2], _ = gap_behind(vehicles, roads, b, slot, back, s, heading)
                return
        back = int(roads.lane_right[back])


@kernel
def _write_turn_way(roads: Roads, back: int, s: float, control: Floats, way: Floats) -> None:
    """Write points of a curve, then `LAST` points along the lane that it leads into."""
    stations = stations_of(control)
    first, end = roads.point_start[back], roads.point_start[back + 1]
    on_curve = len(way) - LAST
    for i in range(on_curve):
        way[i, 0], way[i, 1], way[i, 2] = pose_along(control, stations, stations[-1] * i / on_curve)
    for i in range(LAST):
        place = min(s + i * SPACING, lane_length(roads, back))
        point = segment_at(roads.point_s, first, end, place)
        x, y, heading = centre_at(roads, point, place)
        way[on_curve + i, 0], way[on_curve + i, 1], way[on_curve + i, 2] = x, y, heading
