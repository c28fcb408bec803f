"""Proxies: make vehicles that cross the centre line visible to SUMO's oncoming drivers.

SUMO assigns each vehicle to one lane, and detects overlap only with lanes of the same direction, so oncoming
drivers do not see a shadow (`sumo_shadows`) that crosses the centre line. For such a shadow, a proxy vehicle
of the same size is placed beside it in the oncoming lane until the shadow is back. Proxies exist only in
SUMO.

The speed of a proxy is set after each step, because SUMO takes a proxy that moves towards a driver for a
leader that drives away. A proxy that a driver has passed is replaced by a new vehicle within the same step,
so that the following drivers always see one.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from smarts.geometry.frames import compass_from_heading
from smarts.providers.sumo_library import SumoLibrary
from smarts.roads.lane_graph import LaneGraph

SUFFIX = "-smarts-proxy"
"""Part of a proxy's SUMO id, between the vehicle's id and a number."""

_KEEP_CLOSE = 2
_NO_LANE_CHANGES = 0
_SEAM = 0.5
"""Maximum gap between two opposite lanes that count as adjacent [m]."""


@dataclass
class _Proxy:
    """The state of a proxy between steps."""

    lane: int
    """The lane that it is placed on."""
    id: str = ""
    """SUMO id of its vehicle; empty if it does not exist yet."""
    speed: float = 0.0
    """Speed along that lane [m/s]."""


class SumoProxies:
    """The proxies of one simulation, by the SUMO id of the vehicle that they represent.

    Args:
        library: The copy of libsumo that runs the simulation.
    """

    def __init__(self, library: SumoLibrary) -> None:
        self._library = library
        self._proxies: dict[str, _Proxy] = {}
        self._oncoming: dict[int, int] = {}

    def __contains__(self, name: str) -> bool:
        """Return whether a SUMO vehicle is a proxy."""
        return SUFFIX in name

    def has_one(self, name: str) -> bool:
        """Return whether a vehicle needs a proxy in the next step."""
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
            name: SUMO id of the vehicle.
            lane: Lane of the vehicle.
            leftmost: Largest offset of its footprint to the left of the lane's centreline [m].
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
        """Place a vehicle's proxy at its position of the end of the next step.

        Args:
            name: SUMO id of the vehicle, which needs a proxy.
            kind: SUMO vehicle type of the proxy.
            centre: Centre of the vehicle's footprint at the end of the step [m].
            heading: Heading of the vehicle [rad].
            speed: Speed of the vehicle [m/s].
            length: Length of its footprint [m].
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
        """Correct the proxies' speeds in SUMO, and remove proxies that drivers have passed."""
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
        """Return x, y, heading along a lane of the front of a vehicle with a given centre and length.

        The lane is extended straight beyond its ends.
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
        """Return the lane on the other side of the centre line, or -1."""
        if lane not in self._oncoming:
            self._oncoming[lane] = self._find_lane_across(lane)
        return self._oncoming[lane]

    def _find_lane_across(self, lane: int) -> int:
        roads = self._roads
        if roads.left[lane] >= 0:
            return -1
        x, y, _ = roads.pose_at(lane, float(roads.length[lane]) / 2)
        for other in (
            self._opposite_connections(lane) if roads.is_internal[lane] else self._opposite_lanes(lane)
        ):
            apart = np.hypot(*(roads.centreline(other) - (x, y)).T).min()
            if apart <= (roads.width[lane] + roads.width[other]) / 2 + _SEAM:
                return other
        return -1

    def _opposite_lanes(self, lane: int) -> list[int]:
        """Return the leftmost lanes of the roads opposite to a lane's road."""
        roads = self._roads
        edge = roads.lane_edge[lane]
        returning = (roads.edge_from == roads.edge_to[edge]) & (roads.edge_to == roads.edge_from[edge])
        return [
            roads.edge_lanes(int(other))[-1] for other in np.flatnonzero(returning & ~roads.edge_is_internal)
        ]

    def _opposite_connections(self, lane: int) -> list[int]:
        """Return the lanes inside a junction that connect the lanes opposite to a lane's exit and entry."""
        roads = self._roads
        ends = [*roads.predecessors(lane)[:1].tolist(), *roads.successors(lane)[:1].tolist()]
        if len(ends) < 2 or roads.is_internal[ends].any():
            return []
        to, begin = map(self._lane_across, ends)
        if to < 0 or begin < 0:
            return []
        return [way for way in roads.successors(begin).tolist() if to in roads.successors(way)]
