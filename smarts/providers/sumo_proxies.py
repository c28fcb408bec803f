"""Stand-ins: how SUMO's oncoming drivers see a vehicle that reaches over the centre line.

SUMO keeps a vehicle on one lane, and notes only for lanes of the same direction that it reaches into a second
one; oncoming drivers would drive through it. While a shadow's footprint reaches into the lane on the other
side of the centre line, a second vehicle of the same size therefore is led along that lane beside it. It is
no vehicle of the world, and it is taken away as soon as the footprint is back.

Like shadows (`sumo_shadows`), stand-ins are told their speed after each step, since SUMO takes one that comes
towards a driver for a leader that drives away, and are entered anew when a driver has got past them; here by
another vehicle in its place, so that the drivers behind are not without one for a step.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from smarts.geometry.frames import compass_from_heading
from smarts.providers.sumo_library import SumoLibrary
from smarts.roads.lane_graph import LaneGraph

SUFFIX = "-stand-in"
"""In the SUMO ids of stand-ins, before a number."""

_KEEP_CLOSE = 2
_NO_LANE_CHANGES = 0
_SEAM = 0.5
"""How far apart the edges of two opposite lanes may be for a vehicle to be in both [m]."""


@dataclass
class _StandIn:
    """What is remembered of a stand-in between steps."""

    lane: int
    """That it is led along."""
    id: str = ""
    """Of its vehicle; empty if there is none yet."""
    speed: float = 0.0
    """Along that lane [m/s]."""


class SumoProxies:
    """The stand-ins of one simulation, by the name of the vehicle that they stand in for."""

    def __init__(self, library: SumoLibrary) -> None:
        self._library = library
        self._stand_ins: dict[str, _StandIn] = {}
        self._oncoming: dict[int, int] = {}

    def __contains__(self, name: str) -> bool:
        """Return whether a vehicle of SUMO's is a stand-in."""
        return SUFFIX in name

    def has_one(self, name: str) -> bool:
        """Return whether a vehicle needs a stand-in in the coming step."""
        return name in self._stand_ins

    def reset(self, roads: LaneGraph) -> None:
        """Forget all; SUMO has begun anew."""
        self._roads = roads
        self._numbers = itertools.count()
        self._stand_ins.clear()
        self._oncoming.clear()

    def reach(self, name: str, lane: int, leftmost: float) -> None:
        """Say where a vehicle stands: which stand-in it needs from the next step on follows.

        Args:
            name: Of the vehicle.
            lane: That it is on.
            leftmost: How far its footprint reaches to the left of the lane's middle [m].
        """
        other = self._lane_across(lane) if leftmost > self._roads.width[lane] / 2 else -1
        if other < 0:
            self.remove(name)
        elif name in self._stand_ins:
            self._stand_ins[name].lane = other
        else:
            self._stand_ins[name] = _StandIn(other)

    def place(
        self, name: str, kind: str, centre: tuple[float, float], heading: float, speed: float, length: float
    ) -> None:
        """Put a vehicle's stand-in where it is at the end of the coming step.

        Args:
            name: Of the vehicle; it needs a stand-in.
            kind: Its SUMO vehicle type.
            centre: Of its footprint at the end of the step [m].
            heading: [rad].
            speed: [m/s].
            length: Of its footprint [m].
        """
        stand_in, vehicle = self._stand_ins[name], self._library.vehicle
        if not stand_in.id:
            stand_in.id = f"{name}{SUFFIX}-{next(self._numbers)}"
            vehicle.add(stand_in.id, "", typeID=kind)
            vehicle.setLaneChangeMode(stand_in.id, _NO_LANE_CHANGES)
        x, y, along = self._front_on(stand_in.lane, centre, length)
        stand_in.speed = max(speed * math.cos(heading - along), 0.0)
        vehicle.moveToXY(stand_in.id, "", -1, x, y, compass_from_heading(along), _KEEP_CLOSE, 2.0)

    def settle(self) -> None:
        """See where SUMO has put the stand-ins, and tell it what it got wrong."""
        library, vehicle = self._library, self._library.vehicle
        for stand_in in self._stand_ins.values():
            if not stand_in.id:
                continue
            vehicle.setPreviousSpeed(stand_in.id, stand_in.speed)
            lane, position = vehicle.getLaneID(stand_in.id), vehicle.getLanePosition(stand_in.id)
            if lane and library.is_out_of_order(stand_in.id, lane, position):
                vehicle.remove(stand_in.id)
                stand_in.id = ""

    def remove(self, name: str) -> None:
        """Take a vehicle's stand-in away, if it has one."""
        stand_in = self._stand_ins.pop(name, None)
        if stand_in and stand_in.id:
            self._library.vehicle.remove(stand_in.id)

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
