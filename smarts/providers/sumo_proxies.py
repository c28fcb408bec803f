"""Proxies: vehicles that show SUMO's oncoming drivers a vehicle that reaches over the centre line.

SUMO assigns each vehicle to one lane, so oncoming drivers do not see a shadow that crosses the centre line.
For such a shadow, a proxy vehicle of the same size is placed in the oncoming lane until the shadow is back.
Proxies exist only in SUMO.

Their speed is set after each step, because SUMO would treat an oncoming vehicle as a leader driving away.
After a driver has passed a proxy, it is replaced by a new one within the same step, so that following drivers
always see one.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from smarts.geometry.frames import compass_from_heading
from smarts.providers.sumo_library import SumoLibrary
from smarts.roads.lane_graph import LaneGraph

SUFFIX = "-proxy"
"""In the SUMO ids of proxies, before a number."""

_KEEP_CLOSE = 2
_NO_LANE_CHANGES = 0
_SEAM = 0.5
"""Largest gap between two opposite lanes that a vehicle can be in at once [m]."""


@dataclass
class _Proxy:
    """A proxy between steps."""

    lane: int
    """The lane that it is led along."""
    id: str = ""
    """SUMO id of its vehicle; empty if it has none yet."""
    speed: float = 0.0
    """Along that lane [m/s]."""


class SumoProxies:
    """The proxies of one simulation, by the name of the vehicle that they show."""

    def __init__(self, library: SumoLibrary) -> None:
        self._library = library
        self._proxies: dict[str, _Proxy] = {}
        self._oncoming: dict[int, int] = {}

    def __contains__(self, name: str) -> bool:
        """Return whether a vehicle of SUMO's is a proxy."""
        return SUFFIX in name

    def has_one(self, name: str) -> bool:
        """Return whether a vehicle needs a proxy in the coming step."""
        return name in self._proxies

    def reset(self, roads: LaneGraph) -> None:
        """Clear all proxies; SUMO was restarted."""
        self._roads = roads
        self._numbers = itertools.count()
        self._proxies.clear()
        self._oncoming.clear()

    def reach(self, name: str, lane: int, leftmost: float) -> None:
        """Update which proxy a vehicle needs from the next step on.

        Args:
            name: Of the vehicle.
            lane: That it is on.
            leftmost: How far its footprint reaches to the left of the lane's middle [m].
        """
        other = self._lane_across(lane) if leftmost > self._roads.width[lane] / 2 else -1
        if other < 0:
            self.remove(name)
        elif name in self._proxies:
            self._proxies[name].lane = other
        else:
            self._proxies[name] = _Proxy(other)

    def place(
        self, name: str, kind: str, centre: tuple[float, float], heading: float, speed: float, length: float
    ) -> None:
        """Place a vehicle's proxy for the end of the coming step.

        Args:
            name: Of the vehicle; it needs a proxy.
            kind: Its SUMO vehicle type.
            centre: Of its footprint at the end of the step [m].
            heading: [rad].
            speed: [m/s].
            length: Of its footprint [m].
        """
        proxy, vehicle = self._proxies[name], self._library.vehicle
        if not proxy.id:
            proxy.id = f"{name}{SUFFIX}-{next(self._numbers)}"
            vehicle.add(proxy.id, "", typeID=kind)
            vehicle.setLaneChangeMode(proxy.id, _NO_LANE_CHANGES)
        x, y, along = self._front_on(proxy.lane, centre, length)
        proxy.speed = max(speed * math.cos(heading - along), 0.0)
        vehicle.moveToXY(proxy.id, "", -1, x, y, compass_from_heading(along), _KEEP_CLOSE, 2.0)

    def settle(self) -> None:
        """Read the proxies' positions from SUMO and correct their speeds."""
        library, vehicle = self._library, self._library.vehicle
        for proxy in self._proxies.values():
            if not proxy.id:
                continue
            vehicle.setPreviousSpeed(proxy.id, proxy.speed)
            lane, position = vehicle.getLaneID(proxy.id), vehicle.getLanePosition(proxy.id)
            if lane and library.is_out_of_order(proxy.id, lane, position):
                vehicle.remove(proxy.id)
                proxy.id = ""

    def remove(self, name: str) -> None:
        """Remove a vehicle's proxy, if it has one."""
        proxy = self._proxies.pop(name, None)
        if proxy and proxy.id:
            self._library.vehicle.remove(proxy.id)

    def _front_on(self, lane: int, centre: tuple[float, float], length: float) -> tuple[float, float, float]:
        """Return the place and direction of a front that is half a length past a point, along a lane.

        Beyond the lane's ends it lies straight on.
        """
        points = self._roads.centreline(lane)
        nearest = int(np.hypot(*(points - centre).T).argmin())
        x, y = points[nearest]
        row = self._roads.point_start[lane] + nearest
        along = float(self._roads.point_heading[row])
        ahead = (centre[0] - x) * math.cos(along) + (centre[1] - y) * math.sin(along) + length / 2
        s = float(self._roads.point_s[row]) + ahead
        on_lane = min(max(s, 0.0), float(self._roads.length[lane]))
        x, y, along = self._roads.pose_at(lane, on_lane)
        return x + (s - on_lane) * math.cos(along), y + (s - on_lane) * math.sin(along), along

    def _lane_across(self, lane: int) -> int:
        """Return the lane on the other side of the centre line, -1 where there is none."""
        if lane not in self._oncoming:
            self._oncoming[lane] = self._find_lane_across(lane)
        return self._oncoming[lane]

    def _find_lane_across(self, lane: int) -> int:
        roads = self._roads
        if roads.left[lane] >= 0:
            return -1
        x, y, _ = roads.pose_at(lane, float(roads.length[lane]) / 2)
        for other in self._ways_back(lane) if roads.is_internal[lane] else self._lanes_back(lane):
            apart = np.hypot(*(roads.centreline(other) - (x, y)).T).min()
            if apart <= (roads.width[lane] + roads.width[other]) / 2 + _SEAM:
                return other
        return -1

    def _lanes_back(self, lane: int) -> list[int]:
        """Return the leftmost lanes of the roads that lead back to where a lane's road begins."""
        roads = self._roads
        edge = roads.lane_edge[lane]
        returning = (roads.edge_from == roads.edge_to[edge]) & (roads.edge_to == roads.edge_from[edge])
        return [
            roads.edge_lanes(int(other))[-1] for other in np.flatnonzero(returning & ~roads.edge_is_internal)
        ]

    def _ways_back(self, lane: int) -> list[int]:
        """Return the lanes inside a junction that lead from across a lane's way out to across its way in."""
        roads = self._roads
        ends = [*roads.predecessors(lane)[:1].tolist(), *roads.successors(lane)[:1].tolist()]
        if len(ends) < 2 or roads.is_internal[ends].any():
            return []
        to, begin = map(self._lane_across, ends)
        if to < 0 or begin < 0:
            return []
        return [way for way in roads.successors(begin).tolist() if to in roads.successors(way)]
