"""Turn indicators of vehicles that run: from where they are, and what they have done.

Recorded episodes know what vehicles do next (`recorded_lights`); live, an indicator is on in a turn and after
a lane change.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bytes, Longs
from smarts.geometry.frames import wrap_angle
from smarts.stream.arrays import unpacked_array, unpacked_runs
from smarts.stream.container import Message

TURN_ANGLE = 0.4
"""A way through a junction that bends by more is a turn [rad]."""
AFTER_CHANGE = 0.7
"""Turn indicators are on for so long after a vehicle has come to the lane beside [s]."""
LEFT, RIGHT = 2, 4
"""Bits of `vehicles.lights`."""


class LiveIndicators:
    """The turn indicators of one simulation's vehicles.

    Args:
        road_map: The message of the map.
        dt: Length of a step [s].
    """

    def __init__(self, road_map: Message, dt: float) -> None:
        self._after_change = round(AFTER_CHANGE / dt)
        columns = road_map["lanes"]
        self._edge = unpacked_array(columns["edge"]).astype(np.int64)
        self._turn = _turns_of(columns)
        self._key = np.zeros(0, np.int64)
        self._lane = np.zeros(0, np.int64)
        self._side = np.zeros(0, np.int8)
        self._since = np.zeros(0, np.int64)

    def lights(self, vehicles: Mapping[str, NDArray], step: int) -> Bytes:
        """Return the indicators of the vehicles of a step: bit 1 left, bit 2 right; shape (V,).

        Steps come in order, but not each of them.
        """
        lane = vehicles["lane"].astype(np.int64)
        lane[(lane < 0) | (lane >= len(self._edge))] = -1
        side, since = self._changes(vehicles, lane, step)
        shown = np.where(step - since <= self._after_change, side, 0)
        turns = np.where(lane >= 0, self._turn[lane], 0)
        shown = np.where(turns != 0, turns, shown)
        return np.select([shown > 0, shown < 0], [LEFT, RIGHT], 0).astype(np.int8)

    def _changes(
        self, vehicles: Mapping[str, NDArray], lane: Longs, step: int
    ) -> tuple[NDArray[np.int8], Longs]:
        """Return to which side each vehicle has changed lanes last, and when."""
        key = (vehicles["slot"].astype(np.int64) << 32) + vehicles["generation"].astype(np.int64)
        side, since = np.zeros(len(key), np.int8), np.full(len(key), -(1 << 40), np.int64)
        before = np.full(len(key), -1, np.int64)
        if len(self._key):
            place = np.minimum(np.searchsorted(self._key, key), len(self._key) - 1)
            known = self._key[place] == key
            for new, old in ((side, self._side), (since, self._since), (before, self._lane)):
                new[known] = old[place[known]]
        edge = self._edge
        # Lanes of one edge are consecutive, from the rightmost.
        changed = (before >= 0) & (lane >= 0) & (before != lane) & (edge[before] == edge[lane])
        side[changed] = np.sign(lane - before)[changed]
        since[changed] = step
        order = np.argsort(key, kind="stable")
        self._key, self._lane, self._side, self._since = (each[order] for each in (key, lane, side, since))
        return side, since


def _turns_of(lanes: Mapping[str, Any]) -> NDArray[np.int8]:
    """Return where each lane leads: 1 it turns left, -1 it turns right, 0 neither; shape (L,)."""
    start = unpacked_array(lanes["start"]).astype(np.int64)
    x, y = (unpacked_runs(lanes[name], start[:-1]) for name in "xy")
    heading = np.arctan2(np.diff(y), np.diff(x))
    has_line = np.diff(start) >= 2
    first, last = np.where(has_line, start[:-1], 0), np.where(has_line, start[1:] - 2, 0)
    bend = np.where(has_line, wrap_angle(heading[last] - heading[first]), 0.0)
    is_turn = (unpacked_array(lanes["junction"]) == 1) & (np.abs(bend) > TURN_ANGLE)
    return np.where(is_turn, np.sign(bend), 0).astype(np.int8)
