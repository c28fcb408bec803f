"""Turn indicators of vehicles that run: from where they are, what they have done, where their routes lead.

Recorded episodes know what vehicles do next (`recorded_lights`); live, an indicator before a turn needs a
route or a lane that leads nowhere else.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple
from weakref import WeakValueDictionary

import numpy as np
import shapely
from numpy.typing import NDArray

from smarts.arrays import Bools, Bytes, Floats, Longs
from smarts.geometry.frames import wrap_angle
from smarts.stream.arrays import unpacked_array, unpacked_runs
from smarts.stream.container import Message
from smarts.stream.motion import PER_METRE

TURN_ANGLE = 0.4
"""A way through a junction that bends by more is a turn [rad]."""
BEFORE_TURN = 3.0
"""Turn indicators are on for so long before a turn [s]."""
AFTER_CHANGE = 0.7
"""Turn indicators are on for so long after a vehicle has come to the lane beside [s]."""
LEFT, RIGHT = 2, 4
"""Bits of `vehicles.lights`."""
_NEAR = 0.6
"""Lanes meet where an end and a beginning are no farther apart [m]."""
_MOST_LANES_INSIDE = 8
"""Of one way through a junction."""


class Way(NamedTuple):
    """A way through a junction."""

    edge: int
    """To which it leads."""
    side: int
    """1 it turns left, -1 it turns right, 0 neither."""


class LiveIndicators:
    """The turn indicators of one simulation's vehicles.

    Args:
        road_map: The message of the map.
        dt: Length of a step [s].
    """

    def __init__(self, road_map: Message, dt: float) -> None:
        self._after_change = round(AFTER_CHANGE / dt)
        self._lanes = _lanes_of(road_map)
        self._routes: dict[int, dict[int, int]] = {}
        self._key = np.zeros(0, np.int64)
        self._lane = np.zeros(0, np.int64)
        self._side = np.zeros(0, np.int8)
        self._since = np.zeros(0, np.int64)

    def take_routes(self, routes: Mapping[str, Any]) -> None:
        """Take the table `routes`."""
        self._routes = {
            int(route): dict(zip(map(int, edges), map(int, edges[1:]), strict=False))
            for route, edges in zip(routes.get("route", ()), routes.get("edges", ()), strict=True)
        }

    def lights(self, vehicles: Mapping[str, NDArray], step: int) -> Bytes:
        """Return the indicators of the vehicles of a step: bit 1 left, bit 2 right; shape (V,).

        Steps come in order, but not each of them.
        """
        lane = vehicles["lane"].astype(np.int64)
        lane[(lane < 0) | (lane >= len(self._lanes.edge))] = -1
        side, since = self._changes(vehicles, lane, step)
        shown = np.where(step - since <= self._after_change, side, 0)
        turns = self._turns(lane, vehicles)
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
        edge = self._lanes.edge
        # Lanes of one edge are consecutive, from the rightmost.
        changed = (before >= 0) & (lane >= 0) & (before != lane) & (edge[before] == edge[lane])
        side[changed] = np.sign(lane - before)[changed]
        since[changed] = step
        order = np.argsort(key, kind="stable")
        self._key, self._lane, self._side, self._since = (each[order] for each in (key, lane, side, since))
        return side, since

    def _turns(self, lane: Longs, vehicles: Mapping[str, NDArray]) -> NDArray[np.int8]:
        """Return the side to which each vehicle turns now or soon."""
        lanes = self._lanes
        found = np.where(lane >= 0, lanes.side[lane], 0).astype(np.int8)
        left = lanes.length[lane] - vehicles["s"]
        is_soon = (lane >= 0) & ~lanes.is_inside[lane] & (left <= BEFORE_TURN * vehicles["speed"])
        for row in np.flatnonzero(is_soon).tolist():
            found[row] = self._side_of(int(lane[row]), int(vehicles["route"][row]))
        return found

    def _side_of(self, lane: int, route: int) -> int:
        """Return the side to which a vehicle turns at the end of a lane."""
        edge = self._routes.get(route, {}).get(int(self._lanes.edge[lane]))
        sides = {way.side for way in self._lanes.ways(lane) if edge is None or way.edge == edge}
        return sides.pop() if len(sides) == 1 else 0


def _lanes_of(road_map: Message) -> _Lanes:
    """Return the lanes of a map; episodes on the same one share them while one of them is known."""
    lanes = _known.get(id(road_map))
    if lanes is None:
        lanes = _known[id(road_map)] = _Lanes(road_map)
    return lanes


class _Lanes:
    """Columns of lanes, shape (L,) each."""

    def __init__(self, road_map: Message) -> None:
        # As long as it is there, no other message has its id.
        self._road_map = road_map
        columns = road_map["lanes"]
        start = unpacked_array(columns["start"]).astype(np.int64)
        x, y = (unpacked_runs(columns[name], start[:-1]) / PER_METRE for name in "xy")
        self.edge = unpacked_array(columns["edge"]).astype(np.int64)
        self.is_inside: Bools = unpacked_array(columns["junction"]) == 1
        point: Floats = np.stack([x, y], -1)
        has_line = np.diff(start) >= 2
        first = np.minimum(start[:-1], len(point) - 2)
        last = np.maximum(start[1:] - 1, 1)
        self.begin, self.end = point[first], point[last]
        out, into = point[first + 1] - point[first], point[last] - point[last - 1]
        self.out = np.where(has_line, np.arctan2(out[:, 1], out[:, 0]), 0.0)
        self.into = np.where(has_line, np.arctan2(into[:, 1], into[:, 0]), 0.0)
        along = np.append(0.0, np.cumsum(np.hypot(*np.diff(point, axis=0).T)))
        self.length = along[last] - along[first]
        bend = wrap_angle(self.into - self.out)
        self.side = np.where(self.is_inside & (np.abs(bend) > TURN_ANGLE), np.sign(bend), 0).astype(np.int8)
        begin: Any = shapely.points(self.begin)
        self._tree = shapely.STRtree(begin)
        self._ways: dict[int, list[Way]] = {}

    def after(self, lane: int) -> list[int]:
        """Return the lanes that begin where a lane ends."""
        end: Any = shapely.points(self.end[lane])
        found = self._tree.query(end, predicate="dwithin", distance=_NEAR)
        # Behind a lane shorter than that distance, those that begin beside it are found, too.
        from_end, from_begin = (
            np.hypot(*(self.begin[found] - point[lane]).T) for point in (self.end, self.begin)
        )
        return [other for other in found[from_end <= from_begin].tolist() if other != lane]

    def ways(self, lane: int) -> list[Way]:
        """Return the ways through the junction at the end of a lane."""
        if lane not in self._ways:
            self._ways[lane] = _ways(self, lane)
        return self._ways[lane]


def _ways(lanes: _Lanes, lane: int) -> list[Way]:
    """Return the ways through the junction at the end of a lane."""
    ways: set[Way] = set()
    reached = {lane}
    ahead = [other for other in lanes.after(lane) if lanes.is_inside[other]]
    for _ in range(_MOST_LANES_INSIDE):
        reached.update(ahead)
        following = dict.fromkeys(other for inside in ahead for other in lanes.after(inside))
        for other in following:
            if not lanes.is_inside[other]:
                bend = float(wrap_angle(np.array(lanes.out[other] - lanes.into[lane])))
                ways.add(Way(int(lanes.edge[other]), int(np.sign(bend)) if abs(bend) > TURN_ANGLE else 0))
        # Each lane once: where many meet, the ways through them are more than can be counted.
        ahead = [other for other in following if lanes.is_inside[other] and other not in reached]
    return sorted(ways)


_known: WeakValueDictionary[int, _Lanes] = WeakValueDictionary()
"""By the id of the message."""
