"""The feature `u_turn`: where a vehicle can turn round into the opposite direction."""

from __future__ import annotations

import math
from collections import namedtuple

import numpy as np

from smarts.arrays import Floats
from smarts.geometry.compiling import kernel
from smarts.observations.feature import Feature
from smarts.observations.way_ahead import SPACING, gap_behind
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.curves import curve_into, sharpest_bend, stations_of
from smarts.roads.kernels import lane_length, pose_on_lane
from smarts.roads.lane_ways import place_on_lane
from smarts.roads.turning import is_footprint_over_road, is_opposite
from smarts.types.interface import Field
from smarts.types.world import State

POINTS = 11
"""Points of the lane after the turn: 20 m."""
TURN_LANE, TURN_STATE = "turn_lane", "turn_state"
"""Names of the fields."""
SHARPEST = 0.25
"""Largest curvature of a way round that cars can steer [1/m]."""
LATERAL = 2.0
"""Lateral acceleration in the turn [m/s^2]."""
SPARE = 0.4
"""Added to the vehicle's width where the road has to be wide enough [m]."""


_Out = namedtuple("_Out", "turn_lane turn_state")


class UTurnPlace(Feature):
    """The pose in the other direction into which the vehicle can turn round, and the lane behind it.

    `turn_lane`: points x, y, heading every 2 m; the first is where a curve of `smarts/roads/curves.py` ends
    in the nearest lane of the other direction that cars can steer into with their whole footprint on the
    road; zeros where there is none. `turn_state`: speed in the turn [m/s], 0 where it cannot turn; gap to the
    next vehicle that comes in that lane [m], infinite for none; its speed [m/s].
    """

    in_vector = False

    def fields(self) -> tuple[Field, ...]:
        """Return both arrays."""
        way, inf = "x, y [m], heading [rad] of the lane after the turn", np.inf
        return (
            Field(TURN_LANE, (POINTS, 3), np.float64, -inf, inf, "", way),
            Field(TURN_STATE, (3,), np.float64, 0.0, inf, "", "speed in the turn, oncoming gap and speed"),
        )

    arrays = _Out

    @staticmethod
    @kernel
    def write(state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: _Out) -> None:
        """Write where a turn from the vehicle's pose ends, and what comes in that lane; see `Feature`."""
        _write_turn(state, roads, b, a, out.turn_lane[b, g], out.turn_state[b, g])


@kernel
def _write_turn(state: State, roads: Roads, b: int, a: int, way: Floats, turn: Floats) -> None:
    vehicles, m, slot = state.vehicles, state.map[b], state.agents.slot[b, a]
    way[:], turn[:] = 0.0, 0.0
    turn[1] = np.inf
    lane = vehicles.lane[b, slot]
    if lane < 0 or roads.lane_inside[roads.lane_base[m] + lane]:
        return
    begin = np.empty(3)
    begin[0], begin[1] = vehicles.position[b, slot]
    begin[2], height = vehicles.heading[b, slot], vehicles.height[b, slot]
    back = int(roads.lane_twin[roads.lane_base[m] + lane])
    while back >= 0:
        s, _ = place_on_lane(roads, back, begin[0], begin[1], height)
        room = lane_length(roads, back) - s
        if s > 0.0 and room > SPACING and is_opposite(roads, begin[2], back, s):
            control = curve_into(roads, begin, back, s)
            bend = sharpest_bend(control, stations_of(control))
            length, width = vehicles.length[b, slot], vehicles.width[b, slot] + SPARE
            if bend <= SHARPEST and is_footprint_over_road(roads, m, control, height, length, width):
                turn[0] = math.sqrt(LATERAL / bend)
                _write_lane(roads, back, s, way)
                turn[1], turn[2], _ = gap_behind(vehicles, roads, b, slot, back, s, way[0, 2])
                return
        back = int(roads.lane_right[back])


@kernel
def _write_lane(roads: Roads, lane: int, s: float, way: Floats) -> None:
    """Write points along a lane, up to its end."""
    for i in range(len(way)):
        place = min(s + i * SPACING, lane_length(roads, lane))
        way[i, 0], way[i, 1], way[i, 2] = pose_on_lane(roads, lane, place)
