"""The feature `neighbor_rows`."""

from __future__ import annotations

import math

import numpy as np

from smarts.arrays import Ints, Singles
from smarts.geometry.compiling import kernel
from smarts.observations.crossing_traffic import (
    LONGEST_TIME,
    MOST_MEETINGS,
    PRIORITY,
    STANDING,
    first_meeting,
    meetings_ahead,
)
from smarts.observations.feature import Feature
from smarts.observations.neighbor_sectors import distance_and_time
from smarts.observations.neighbors import NEIGHBORS, neighbors_within, velocity
from smarts.observations.scales import LONGEST_TIME as LONGEST_TIME_TO_COLLISION
from smarts.observations.scales import RADIUS, SIGHT, SPEED_SCALE, compressed
from smarts.roads.arrays import Roads, RouteTable
from smarts.types.interface import Field
from smarts.types.world import State

ROW_VALUES = 13
"""Of each vehicle; see `NeighborRows`."""


class NeighborRows(Feature):
    """The eight nearest vehicles within 50 m, a row each: a set, for networks with `set_width`.

    Of each: 1 - distance / 50 m; position ahead and to the left, and velocity relative to the own one ahead
    and to the left, compressed; cosine and sine of its direction from straight ahead (its sector), and of
    its heading relative to the own one; 1 - time to collision / 5 s at the present closing speed, 0 where
    the two do not approach; then, where its lanes overlap the way through the junction ahead (as in
    `crossing_traffic`): 1 - time / 10 s until it is there, the agent's distance to the overlap, compressed,
    and priority, 1 if the agent gives way, -1 if the vehicle does. Rows of zeros for fewer vehicles.
    """

    in_vector = False

    def fields(self) -> tuple[Field, ...]:
        """Return the rows."""
        shape, meaning = (NEIGHBORS, ROW_VALUES), "the nearest vehicles, a row each; zeros for none"
        return (Field("neighbor_rows", shape, np.float32, -1.0, 1.0, "", meaning),)

    @staticmethod
    @kernel
    def write(
        state: State, roads: Roads, routes: RouteTable, agent_ids: Ints, b: int, g: int, out: Singles
    ) -> None:
        """Write an agent's rows, shape (8, 13); see `Feature`."""
        vehicles, a = state.vehicles, agent_ids[g]
        own = state.agents.slot[b, a]
        found, squares = np.empty(NEIGHBORS, np.int32), np.empty(NEIGHBORS)
        count = neighbors_within(vehicles, b, own, found, squares)
        places, begins = np.empty(MOST_MEETINGS, np.int32), np.empty(MOST_MEETINGS)
        meetings = meetings_ahead(state, roads, routes, b, a, places, begins)
        cos, sin = math.cos(vehicles.heading[b, own]), math.sin(vehicles.heading[b, own])
        own_vx, own_vy = velocity(vehicles, b, own)
        out[:] = 0.0
        for row in range(count):
            slot = found[row]
            dx = vehicles.position[b, slot, 0] - vehicles.position[b, own, 0]
            dy = vehicles.position[b, slot, 1] - vehicles.position[b, own, 1]
            ahead, left = dx * cos + dy * sin, dy * cos - dx * sin
            vx, vy = velocity(vehicles, b, slot)
            vx, vy = vx - own_vx, vy - own_vy
            turn = vehicles.heading[b, slot] - vehicles.heading[b, own]
            distance, time = distance_and_time(vehicles, b, own, slot)
            out[row, 0] = 1.0 - distance / RADIUS
            out[row, 1] = compressed(ahead, RADIUS)
            out[row, 2] = compressed(left, RADIUS)
            out[row, 3] = compressed(vx * cos + vy * sin, SPEED_SCALE)
            out[row, 4] = compressed(vy * cos - vx * sin, SPEED_SCALE)
            out[row, 5] = ahead / max(distance, 1e-6)
            out[row, 6] = left / max(distance, 1e-6)
            out[row, 7] = math.cos(turn)
            out[row, 8] = math.sin(turn)
            out[row, 9] = 1.0 - time / LONGEST_TIME_TO_COLLISION
            if meetings == 0 or vehicles.lane[b, slot] < 0:
                continue
            where, gap = first_meeting(vehicles, roads, routes, state.map[b], b, slot, places[:meetings])
            arrival = gap / max(vehicles.speed[b, slot], STANDING)
            if where >= 0 and arrival < LONGEST_TIME:
                out[row, 10] = 1.0 - arrival / LONGEST_TIME
                out[row, 11] = compressed(begins[where], SIGHT)
                out[row, 12] = PRIORITY[roads.conflict_yields[places[where]]]
