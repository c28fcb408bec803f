"""The traffic lights ahead of the agent's vehicle."""

from __future__ import annotations

import enum
from collections import namedtuple
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import numpy as np

from smarts.agents.options import Signals
from smarts.arrays import Bytes, Floats, Ints
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.kernels import lane_length
from smarts.roads.lane_ways import row_of
from smarts.roads.scene import Scene
from smarts.sensors.bounds import FARTHEST, MOST, clipped, clipped_above
from smarts.sensors.nearest import keep_nearest
from smarts.sensors.protocol import KernelSensor, Readings, Seen
from smarts.types.coordinates import Point
from smarts.types.interface import Field
from smarts.types.traffic import Signal
from smarts.types.world import State

_NONE = int(Signal.NONE)
_MOST_OPEN = 64


class SignalLightState(enum.IntFlag):
    """What a light shows; numbers are the original's."""

    UNKNOWN = 0
    OFF = 0
    STOP = 1
    CAUTION = 2
    GO = 4


class SignalObservation(NamedTuple):
    """A traffic light ahead."""

    state: SignalLightState
    stop_point: Point
    controlled_lanes: tuple[str, ...]
    """The lane behind the light, inside the junction."""
    last_changed: float | None = None
    """Not known here."""


_LIGHTS = {
    Signal.NONE: SignalLightState.UNKNOWN,
    Signal.STOP: SignalLightState.STOP,
    Signal.CAUTION: SignalLightState.CAUTION,
    Signal.GO: SignalLightState.GO,
}


_Out = namedtuple("_Out", "count state stop_point distance lane")
"""Shape (B, G, ...), K lights each."""


@dataclass(frozen=True)
class SignalsAhead(KernelSensor):
    """The lights that govern the lanes ahead, nearest first.

    The lanes are those that the vehicle's own lane leads into along its route; where it leads off the route,
    all that it leads into.
    """

    option: Signals = field(default_factory=Signals)
    arrays: ClassVar[type] = _Out

    def fields(self) -> tuple[Field, ...]:
        """Return the fields."""
        k = self.option.most
        states = ", ".join(f"{state.value} {state.name.lower()}" for state in Signal)
        return (
            Field("count", (), np.int32, 0, k, "", "how many lights follow; the entries after them are 0"),
            Field("state", (k,), np.int8, 0, max(Signal), "", f"what the light shows: {states}"),
            Field("stop_point", (k, 2), np.float64, -FARTHEST, FARTHEST, "m", "where to wait if it is red"),
            Field("distance", (k,), np.float32, 0, FARTHEST, "m", "from the centre to the stop point"),
            Field("lane", (k,), np.int32, 0, MOST, "", "the lane behind the light, number in the map"),
        )

    def known(self, scene: Scene) -> tuple[Any, ...]:
        """Return what the kernel needs besides the state."""
        most = self.option.most
        found = np.empty(most, np.int32), np.empty(most)
        ahead = np.empty(_MOST_OPEN, np.int32), np.empty(_MOST_OPEN)
        return ((float(self.option.lookahead), *found, *ahead),)

    @staticmethod
    @kernel
    def write(
        state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: _Out, known: Any
    ) -> None:
        """Write an agent's readings; see `KernelSensor`."""
        lookahead, lanes, far, rows, begins = known
        vehicles, agents, signals = state.vehicles, state.agents, state.signals
        v = agents.slot[b, a]
        own, base, count = vehicles.lane[b, v], roads.lane_base[state.map[b]], 0
        if own >= 0:
            done = agents.route_progress[b, a]
            row = row_of(routes, state.map[b], routes.number[b, a], base + own, base, done)
            if routes.onward_start[row] == routes.onward_start[row + 1]:
                row = int(routes.start[state.map[b]] + own)
            left = lane_length(roads, base + own) - clipped(vehicles.lane_position[b, v], FARTHEST)
            count = _find(roads, routes, row, base, left, lookahead, signals[b], rows, begins, lanes, far)
        out.count[b, g] = count
        for k in range(count):
            first = roads.point_start[lanes[k]]
            out.state[b, g, k] = signals[b, lanes[k] - base]
            out.stop_point[b, g, k, 0] = clipped(roads.point_xy[first, 0], FARTHEST)
            out.stop_point[b, g, k, 1] = clipped(roads.point_xy[first, 1], FARTHEST)
            out.distance[b, g, k] = clipped_above(far[k], FARTHEST)
            out.lane[b, g, k] = lanes[k] - base
        out.state[b, g, count:] = 0
        out.stop_point[b, g, count:] = 0.0
        out.distance[b, g, count:] = 0.0
        out.lane[b, g, count:] = 0

    @staticmethod
    def as_object(readings: Readings, seen: Seen) -> tuple[SignalObservation, ...]:
        """Return the lights, nearest first."""
        return tuple(
            SignalObservation(
                state=_LIGHTS[Signal(int(readings["state"][k]))],
                stop_point=Point(*readings["stop_point"][k].tolist()),
                controlled_lanes=(seen.lane_ids(int(readings["lane"][k]))[1],),
            )
            for k in range(int(readings["count"]))
        )


@kernel
def _find(
    roads: Roads,
    table: RouteTable,
    row: int,
    base: int,
    left: float,
    lookahead: float,
    signals: Bytes,
    rows: Ints,
    begins: Floats,
    lanes: Ints,
    far: Floats,
) -> int:
    """List the lanes with lights that a row leads into, nearest first, as many as there is room.

    `left` [m] is what is left of the row's own lane; `rows` and `begins` are room for lanes yet to be seen.
    """
    found, looked = 0, 0
    rows[0], begins[0], open_rows = row, left - lane_length(roads, table.lane[row]), 1
    while open_rows > 0 and looked < _MOST_OPEN:
        open_rows -= 1
        looked += 1
        row, end = rows[open_rows], begins[open_rows] + lane_length(roads, table.lane[rows[open_rows]])
        if end > lookahead:
            continue
        for entry in range(table.onward_start[row], table.onward_start[row + 1]):
            following = table.onward[entry]
            lane = table.lane[following]
            if signals[lane - base] != _NONE:
                found = keep_nearest(lanes, far, found, lane, end)
            if open_rows < len(rows):
                rows[open_rows], begins[open_rows] = following, end
                open_rows += 1
    return found
