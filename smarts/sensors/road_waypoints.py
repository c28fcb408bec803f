"""Waypoints in all lanes of the road that the agent's vehicle is on, independent of the agent's route."""

from __future__ import annotations

from collections import namedtuple
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import numpy as np

from smarts.agents.options import RoadWaypoints as RoadWaypointOption
from smarts.arrays import Bools, Ints
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.kernels import lane_length, pose_on_lane
from smarts.roads.lane_ways import place_on_lane
from smarts.roads.scene import Scene
from smarts.roads.waypoints import foot
from smarts.sensors.bounds import MOST
from smarts.sensors.protocol import KernelSensor, Readings, Seen
from smarts.sensors.road_links import RoadLinks, road_links
from smarts.sensors.waypoint import Waypoint, clear_waypoints, waypoint_fields, waypoints_of, write_waypoint
from smarts.types.interface import Field
from smarts.types.world import State


class RoadWaypoints(NamedTuple):
    """Waypoints in all lanes of the road."""

    lanes: dict[str, list[list[Waypoint]]]
    """By the id of the lane that is beside the vehicle; one path for each."""


_Out = namedtuple(
    "_Out",
    "lane_count left_out oncoming waypoint_count beside position heading lane_width speed_limit "
    "lane lane_index lane_offset",
)
"""Shape (B, G, ...), K lanes of W waypoints each."""


@dataclass(frozen=True)
class RoadWaypointsAround(KernelSensor):
    """Waypoints a metre apart behind and ahead of the vehicle in every lane of its road.

    Lanes of its own direction come first, from the right to the left, then the oncoming ones, from their
    right to their left; each lane's waypoints are in the lane's own direction. Beyond the road's ends the
    waypoints follow the way that turns least. Of more lanes than there is room for, those nearest to the
    vehicle's own lane are kept, with it.
    """

    option: RoadWaypointOption = field(default_factory=RoadWaypointOption)
    arrays: ClassVar[type] = _Out

    def fields(self) -> tuple[Field, ...]:
        """Return the fields."""
        k, w = self.option.lanes, 2 * self.option.horizon + 1
        return (
            Field("lane_count", (), np.int32, 0, k, "", "how many lanes there are; the others are 0"),
            Field("left_out", (), np.int32, 0, MOST, "", "lanes that did not fit"),
            Field("oncoming", (k,), np.int8, 0, 1, "", "1 if the lane leads the other way"),
            Field("waypoint_count", (k,), np.int32, 0, w, "", "waypoints of each lane; those after are 0"),
            Field("beside", (k,), np.int32, 0, w, "", "which of them is beside the vehicle"),
            *waypoint_fields(k, w),
        )

    def known(self, scene: Scene) -> tuple[Any, ...]:
        """Return what the kernel needs besides the state."""
        return ((self.option.horizon, road_links(scene.atlas)),)

    @staticmethod
    @kernel
    def write(
        state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: _Out, known: Any
    ) -> None:
        """Write an agent's readings; see `KernelSensor`."""
        horizon, links = known
        base = roads.lane_base[state.map[b]]
        vehicles, most = state.vehicles, out.beside.shape[2]
        v, count = state.agents.slot[b, a], 0
        place = vehicles.position[b, v, 0], vehicles.position[b, v, 1], vehicles.height[b, v]
        out.left_out[b, g] = 0
        if vehicles.lane[b, v] >= 0:
            own = base + vehicles.lane[b, v]
            first, last = links.beside_start[own], links.beside_start[own + 1]
            kept = _nearest_lanes(roads, links.beside[first:last], own, most, place)
            out.left_out[b, g] = last - first - np.count_nonzero(kept)
            for entry in range(first, last):
                if not kept[entry - first]:
                    continue
                lane = links.beside[entry]
                out.oncoming[b, g, count] = entry - first >= links.own_count[own]
                _write_lane(roads, links, base, lane, foot(roads, lane, *place), horizon, b, g, count, out)
                clear_waypoints(out, b, g, count, out.waypoint_count[b, g, count])
                count += 1
        out.lane_count[b, g] = count
        for k in range(count, most):
            out.oncoming[b, g, k] = 0
            out.beside[b, g, k], out.waypoint_count[b, g, k] = 0, 0
            clear_waypoints(out, b, g, k, 0)

    @staticmethod
    def as_object(readings: Readings, seen: Seen) -> RoadWaypoints:
        """Return the lanes' waypoints."""
        lanes: dict[str, list[list[Waypoint]]] = {}
        for number in range(int(readings["lane_count"])):
            points = waypoints_of(readings, seen, number, int(readings["waypoint_count"][number]))
            lanes.setdefault(points[int(readings["beside"][number])].lane_id, []).append(points)
        return RoadWaypoints(lanes)


@kernel
def _nearest_lanes(
    roads: Roads, lanes: Ints, own: int, most: int, place: tuple[float, float, float]
) -> Bools:
    """Return which lanes there is room for: a vehicle's own one, and of the others the nearest."""
    kept = np.ones(len(lanes), np.bool_)
    if len(lanes) > most:
        away = np.empty(len(lanes))
        for number, lane in enumerate(lanes):
            away[number] = -1.0 if lane == own else abs(place_on_lane(roads, lane, *place)[1])
        kept[np.argsort(away, kind="mergesort")[most:]] = False
    return kept


@kernel
def _one_back(roads: Roads, links: RoadLinks, lane: int, s: float) -> tuple[int, float]:
    """Return the place a metre behind another, lane -1 if there is none."""
    s -= 1.0
    while s < 0.0 and lane >= 0:
        lane = links.behind[lane]
        if lane >= 0:
            s += lane_length(roads, lane)
    return lane, s


@kernel
def _one_on(roads: Roads, links: RoadLinks, lane: int, s: float) -> tuple[int, float]:
    """Return the place a metre ahead of another, lane -1 if there is none."""
    s += 1.0
    while lane >= 0 and s > lane_length(roads, lane):
        s -= lane_length(roads, lane)
        lane = links.ahead[lane]
    return lane, s


@kernel
def _write(roads: Roads, base: int, lane: int, s: float, place: tuple[int, int, int, int], out: _Out) -> None:
    pose = pose_on_lane(roads, lane, s)
    write_waypoint(roads, base, lane, s, pose, roads.lane_speed[lane], place, out)


@kernel
def _write_lane(
    roads: Roads,
    links: RoadLinks,
    base: int,
    lane: int,
    foot: float,
    horizon: int,
    b: int,
    g: int,
    k: int,
    out: _Out,
) -> None:
    """Write the waypoints of one lane and of those before and after it."""
    behind = 0
    at, s = _one_back(roads, links, lane, foot)
    while behind < horizon and at >= 0:
        behind += 1
        at, s = _one_back(roads, links, at, s)
    at, s = lane, foot
    for step in range(behind):
        at, s = _one_back(roads, links, at, s)
        _write(roads, base, at, s, (b, g, k, behind - 1 - step), out)
    count = behind
    at, s = lane, foot
    while at >= 0 and count <= behind + horizon:
        _write(roads, base, at, s, (b, g, k, count), out)
        count += 1
        at, s = _one_on(roads, links, at, s)
    out.beside[b, g, k], out.waypoint_count[b, g, k] = behind, count
