"""The feature `neighbor_rows`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from pydantic import PositiveFloat, PositiveInt

from smarts.arrays import Singles
from smarts.errors import SmartsError, nearest_names
from smarts.geometry.compiling import kernel
from smarts.observations.context import AdapterContext
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

COLUMNS = (
    *("nearness", "ahead", "left", "velocity_ahead", "velocity_left"),
    *("direction_cos", "direction_sin", "heading_cos", "heading_sin", "urgency"),
    *("meeting_soonness", "meeting_distance", "meeting_priority"),
)
"""What is known of each vehicle; see `NeighborRows`."""


class NeighborRows(Feature):
    """The nearest vehicles, a row each, nearest first: a set, for networks with `set_width`.

    Columns of a vehicle: `nearness`, 1 - distance / radius; position `ahead` and to the `left`, and
    `velocity_ahead` and `velocity_left` relative to the own one, compressed; `direction_cos` and
    `direction_sin` of its direction from straight ahead (its sector); `heading_cos` and `heading_sin` of its
    heading relative to the own one; `urgency`, 1 - time to collision / 5 s at the present closing speed, 0
    where the two do not approach. Then, where its lanes overlap the way through the junction ahead (as in
    `crossing_traffic`): `meeting_soonness`, 1 - time / 10 s until it is there; `meeting_distance` of the
    agent to the overlap, compressed; and `meeting_priority`, 1 if the agent gives way, -1 if the vehicle
    does. Rows of zeros for fewer vehicles.

    Args:
        context: The agents.
        rows: How many vehicles, at most.
        radius: How far they are seen [m].
        columns: Names of columns, in this order; by default all.

    Raises:
        SmartsError: There is no such column.
    """

    in_vector = False

    def __init__(
        self,
        context: AdapterContext,
        rows: PositiveInt = NEIGHBORS,
        radius: PositiveFloat = RADIUS,
        columns: Sequence[str] = COLUMNS,
    ) -> None:
        super().__init__(context)
        for name in columns:
            if name not in COLUMNS:
                remedy = nearest_names(str(name), COLUMNS)
                raise SmartsError(
                    f"there is no column {name!r}", place="feature neighbor_rows", remedy=remedy
                )
        self._rows, self._radius, self._columns = rows, float(radius), columns

    def fields(self) -> tuple[Field, ...]:
        """Return the rows."""
        shape = self._rows, len(self._columns)
        meaning = "the nearest vehicles, a row each; zeros for none"
        return (Field("neighbor_rows", shape, np.float32, -1.0, 1.0, "", meaning),)

    def known(self) -> tuple[Any, ...]:
        """Return the radius [m], and the numbers of the columns."""
        return ((self._radius, np.array([COLUMNS.index(name) for name in self._columns])),)

    @staticmethod
    @kernel
    def write(
        state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: Singles, known: Any
    ) -> None:
        """Write an agent's rows, shape (rows, columns); see `Feature`."""
        radius, columns = known
        vehicles, own = state.vehicles, state.agents.slot[b, a]
        found, squares = np.empty(len(out), np.int32), np.empty(len(out))
        count = neighbors_within(vehicles, b, own, radius, found, squares)
        places, begins = np.empty(MOST_MEETINGS, np.int32), np.empty(MOST_MEETINGS)
        meetings = meetings_ahead(state, roads, routes, b, a, places, begins)
        cos, sin = math.cos(vehicles.heading[b, own]), math.sin(vehicles.heading[b, own])
        own_vx, own_vy = velocity(vehicles, b, own)
        values = np.empty(len(COLUMNS))
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
            values[0] = 1.0 - distance / radius
            values[1] = compressed(ahead, radius)
            values[2] = compressed(left, radius)
            values[3] = compressed(vx * cos + vy * sin, SPEED_SCALE)
            values[4] = compressed(vy * cos - vx * sin, SPEED_SCALE)
            values[5] = ahead / max(distance, 1e-6)
            values[6] = left / max(distance, 1e-6)
            values[7] = math.cos(turn)
            values[8] = math.sin(turn)
            values[9] = 1.0 - time / LONGEST_TIME_TO_COLLISION
            values[10:] = 0.0
            if meetings > 0 and vehicles.lane[b, slot] >= 0:
                where, gap = first_meeting(vehicles, roads, routes, state.map[b], b, slot, places[:meetings])
                arrival = gap / max(vehicles.speed[b, slot], STANDING)
                if where >= 0 and arrival < LONGEST_TIME:
                    values[10] = 1.0 - arrival / LONGEST_TIME
                    values[11] = compressed(begins[where], SIGHT)
                    values[12] = PRIORITY[roads.conflict_yields[places[where]]]
            for column in range(len(columns)):
                out[row, column] = values[columns[column]]
