"""Stand-ins: how SUMO's oncoming drivers see a vehicle that reaches over the centre line.

SUMO keeps a vehicle on one lane, and notes only for lanes of the same direction that it reaches into a second
one; oncoming drivers would drive through it. While a shadow's footprint reaches into the lane on the other
side of the centre line, a second vehicle of the same size therefore is led along that lane beside it. It is
no vehicle of the world, and it is taken away as soon as the footprint is back.
"""

from __future__ import annotations

import math

import numpy as np

from smarts.geometry.frames import compass_from_heading
from smarts.providers.sumo_library import SumoLibrary
from smarts.roads.lane_graph import LaneGraph

SUFFIX = "-stand-in"
"""Of the SUMO ids of stand-ins."""

_KEEP_CLOSE = 2
_NO_LANE_CHANGES = 0
_SEAM = 0.5
"""How far apart the edges of two opposite lanes may be for a vehicle to be in both [m]."""


class SumoStandIns:
    """The stand-ins of one simulation, by the name of the vehicle that they stand in for."""

    def __init__(self, library: SumoLibrary) -> None:
        self._library = library
        self._lanes: dict[str, int] = {}
        self._oncoming: dict[int, int] = {}

    def __contains__(self, name: str) -> bool:
        """Return whether a vehicle of SUMO's is a stand-in."""
        return name.endswith(SUFFIX)

    def has_one(self, name: str) -> bool:
        """Return whether a vehicle needs a stand-in in the coming step."""
        return name in self._lanes

    def reset(self, roads: LaneGraph) -> None:
        """Forget all; SUMO has begun anew."""
        self._roads = roads
        self._lanes.clear()
        self._oncoming.clear()

    def reach(self, name: str, lane: int, offset: float, width: float) -> None:
        """Say where a vehicle stands: which stand-in it needs from the next step on follows.

        Args:
            name: Of the vehicle.
            lane: That it is on, -1 off the road.
            offset: Of its middle to the left of the lane's [m].
            width: Of its footprint [m].
        """
        reaches = lane >= 0 and offset + width / 2 > self._roads.width[lane] / 2
        other = self._lane_across(lane) if reaches else -1
        if other < 0 or other != self._lanes.get(name, other):
            self.remove(name)
        if other >= 0:
            self._lanes[name] = other

    def place(
        self, name: str, kind: str, centre: tuple[float, float], heading: float, speed: float, length: float
    ) -> None:
        """Put a vehicle's stand-in, if it needs one, where it is at the end of the coming step.

        Args:
            name: Of the vehicle.
            kind: Its SUMO vehicle type.
            centre: Of its footprint at the end of the step [m].
            heading: [rad].
            speed: [m/s].
            length: Of its footprint [m].
        """
        lane = self._lanes.get(name, -1)
        if lane < 0:
            return
        vehicle, stand_in = self._library.vehicle, name + SUFFIX
        if stand_in not in vehicle.getIDList():
            vehicle.add(stand_in, "", typeID=kind)
            vehicle.setLaneChangeMode(stand_in, _NO_LANE_CHANGES)
        x, y, along = self._front_on(lane, centre, length)
        vehicle.moveToXY(stand_in, "", -1, x, y, compass_from_heading(along), _KEEP_CLOSE, 2.0)
        vehicle.setPreviousSpeed(stand_in, max(speed * math.cos(heading - along), 0.0))

    def remove(self, name: str) -> None:
        """Take a vehicle's stand-in away, if it has one."""
        if self._lanes.pop(name, -1) >= 0 and name + SUFFIX in self._library.vehicle.getIDList():
            self._library.vehicle.remove(name + SUFFIX)

    def _front_on(self, lane: int, centre: tuple[float, float], length: float) -> tuple[float, float, float]:
        """Return the place and direction of a front that is half a length past a point, along a lane."""
        points = self._roads.centreline(lane)
        nearest = int(np.hypot(*(points - centre).T).argmin())
        x, y = points[nearest]
        along = float(self._roads.point_heading[self._roads.point_start[lane] + nearest])
        ahead = (centre[0] - x) * math.cos(along) + (centre[1] - y) * math.sin(along) + length / 2
        s = float(self._roads.point_s[self._roads.point_start[lane] + nearest]) + ahead
        return self._roads.pose_at(lane, min(max(s, 0.0), float(self._roads.length[lane])))

    def _lane_across(self, lane: int) -> int:
        """Return the lane on the other side of the centre line, -1 where there is none."""
        if lane not in self._oncoming:
            self._oncoming[lane] = self._find_lane_across(lane)
        return self._oncoming[lane]

    def _find_lane_across(self, lane: int) -> int:
        roads = self._roads
        if roads.is_internal[lane] or roads.left[lane] >= 0:
            return -1
        edge = roads.lane_edge[lane]
        returning = (roads.edge_from == roads.edge_to[edge]) & (roads.edge_to == roads.edge_from[edge])
        x, y, _ = roads.pose_at(lane, float(roads.length[lane]) / 2)
        for other_edge in np.flatnonzero(returning & ~roads.edge_is_internal):
            other = roads.edge_lanes(int(other_edge))[-1]
            apart = np.hypot(*(roads.centreline(other) - (x, y)).T).min()
            if apart <= (roads.width[lane] + roads.width[other]) / 2 + _SEAM:
                return int(other)
        return -1
