"""The traffic lights ahead of the agent's vehicle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from smarts.agents.options import Signals
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.kernels import find_row, lane_length
from smarts.roads.scene import Scene
from smarts.sensors.bounds import FARTHEST, MOST, clipped, clipped_above
from smarts.types.interface import Field
from smarts.types.traffic import Signal

Bools = NDArray[np.bool_]
Bytes = NDArray[np.int8]
Ints = NDArray[np.int32]
Floats = NDArray[np.float64]
Singles = NDArray[np.float32]

_NONE = int(Signal.NONE)
_MOST_OPEN = 64


@dataclass(frozen=True)
class SignalsAhead:
    """The lights that govern the lanes ahead, nearest first.

    The lanes are those that the vehicle's own lane leads into along its route; where it leads off the route,
    all that it leads into.
    """

    option: Signals = field(default_factory=Signals)

    def fields(self) -> tuple[Field, ...]:
        """Return what is reported."""
        k = self.option.most
        states = ", ".join(f"{state.value} {state.name.lower()}" for state in Signal)
        return (
            Field("count", (), np.int32, 0, k, "", "how many lights follow; the entries after them are 0"),
            Field("state", (k,), np.int8, 0, max(Signal), "", f"what the light shows: {states}"),
            Field("stop_point", (k, 2), np.float64, -FARTHEST, FARTHEST, "m", "where to wait if it is red"),
            Field("distance", (k,), np.float32, 0, FARTHEST, "m", "from the centre to the stop point"),
            Field("lane", (k,), np.int32, 0, MOST, "", "the lane behind the light, number in the map"),
        )

    def observe(self, scene: Scene, agent_ids: Ints, observe_mask: Bools, out: Mapping[str, NDArray]) -> None:
        """Write the readings of the wanted agents."""
        world = scene.world
        _observe(
            agent_ids,
            observe_mask,
            world.agents.slot,
            scene.atlas.roads,
            scene.routes.table,
            scene.routes.number,
            world.agents.route_progress,
            world.map,
            world.signals,
            world.vehicles.lane,
            world.vehicles.lane_position,
            self.option.lookahead,
            out["count"],
            out["state"],
            out["stop_point"],
            out["distance"],
            out["lane"],
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
            if signals[lane - base] != _NONE and not (found == len(lanes) and end >= far[found - 1]):
                place = min(found, len(lanes) - 1)
                while place > 0 and far[place - 1] > end:
                    lanes[place], far[place] = lanes[place - 1], far[place - 1]
                    place -= 1
                lanes[place], far[place] = lane, end
                found = min(found + 1, len(lanes))
            if open_rows < len(rows):
                rows[open_rows], begins[open_rows] = following, end
                open_rows += 1
    return found


@kernel
def _observe(
    agent_ids: Ints,
    observe_mask: Bools,
    slots: Ints,
    roads: Roads,
    table: RouteTable,
    route: Ints,
    route_progress: Floats,
    maps: Ints,
    signals: Bytes,
    lane: Ints,
    s: Floats,
    lookahead: float,
    count_out: Ints,
    state_out: Bytes,
    stop_out: Floats,
    distance_out: Singles,
    lane_out: Ints,
) -> None:
    most = state_out.shape[2]
    lanes, far = np.empty(most, np.int32), np.empty(most)
    rows, begins = np.empty(_MOST_OPEN, np.int32), np.empty(_MOST_OPEN)
    for b in range(observe_mask.shape[0]):
        for g in range(observe_mask.shape[1]):
            if not observe_mask[b, g]:
                continue
            a = agent_ids[g]
            own, base, count = lane[b, slots[b, a]], roads.lane_base[maps[b]], 0
            if own >= 0:
                row = -1
                if route[b, a] >= 0:
                    row = find_row(table, table.free + route[b, a], base + own, route_progress[b, a])
                if row < 0 or table.onward_start[row] == table.onward_start[row + 1]:
                    row = int(table.start[maps[b]] + own)
                left = lane_length(roads, base + own) - clipped(s[b, slots[b, a]], FARTHEST)
                count = _find(roads, table, row, base, left, lookahead, signals[b], rows, begins, lanes, far)
            count_out[b, g] = count
            for k in range(count):
                first = roads.point_start[lanes[k]]
                state_out[b, g, k] = signals[b, lanes[k] - base]
                stop_out[b, g, k, 0] = clipped(roads.point_xy[first, 0], FARTHEST)
                stop_out[b, g, k, 1] = clipped(roads.point_xy[first, 1], FARTHEST)
                distance_out[b, g, k] = clipped_above(far[k], FARTHEST)
                lane_out[b, g, k] = lanes[k] - base
            state_out[b, g, count:] = 0
            stop_out[b, g, count:] = 0.0
            distance_out[b, g, count:] = 0.0
            lane_out[b, g, count:] = 0
