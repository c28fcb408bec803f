"""The paths ahead of the agent's vehicle."""

from __future__ import annotations

from collections import namedtuple
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from smarts.agents.options import Waypoints
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.guide import is_led, write_led_path
from smarts.roads.lane_graph import LaneKind
from smarts.roads.scene import Scene
from smarts.roads.waypoints import WaypointPaths, write_waypoints
from smarts.sensors.bounds import MOST
from smarts.sensors.protocol import KernelSensor, Readings, Seen
from smarts.sensors.waypoint import Waypoint, clear_waypoints, waypoint_fields, waypoints_of, write_waypoint
from smarts.types.interface import Field
from smarts.types.vehicles import VehicleKind
from smarts.types.world import State

_CAR_LANES = 1 << LaneKind.CAR
_BUS_LANES = 1 << LaneKind.CAR | 1 << LaneKind.BUS
_BUS, _COACH = int(VehicleKind.BUS), int(VehicleKind.COACH)


_Out = namedtuple(
    "_Out",
    "path_count left_out waypoint_count position heading lane_width speed_limit lane lane_index lane_offset",
)
"""Shape (B, G, ...), K paths of W waypoints each."""


@dataclass(frozen=True)
class WaypointPathsAhead(KernelSensor):
    """A path for each lane of the road that the vehicle may use, from the right to the left, along the route.

    `smarts.roads.waypoints.WaypointPaths` says how paths run, branch and end. An agent that its mission's
    task leads (`smarts.types.guidance`) gets one path instead: its lane as far as the manoeuvre, then the
    curve into the other lane. Where the task says how fast to drive, that is every waypoint's limit.
    """

    option: Waypoints = field(default_factory=Waypoints)
    arrays: ClassVar[type] = _Out

    def fields(self) -> tuple[Field, ...]:
        """Return the fields."""
        k, w = self.option.paths, self.option.lookahead
        return (
            Field("path_count", (), np.int32, 0, k, "", "how many paths there are; the others are 0"),
            Field("left_out", (), np.int32, 0, MOST, "", "paths that did not fit, without where they fork"),
            Field(
                "waypoint_count", (k,), np.int32, 0, w, "", "waypoints of each path; those after them are 0"
            ),
            *waypoint_fields(k, w),
        )

    def known(self, scene: Scene) -> tuple[Any, ...]:
        """Return what the kernel needs besides the state."""
        paths = WaypointPaths.allocate(self.option.paths, self.option.lookahead)
        return ((float(self.option.spacing), paths),)

    @staticmethod
    @kernel
    def write(
        state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: _Out, known: Any
    ) -> None:
        """Write an agent's readings; see `KernelSensor`."""
        spacing, paths = known
        vehicles, agents, guide = state.vehicles, state.agents, state.guidance
        v, m, base = agents.slot[b, a], state.map[b], roads.lane_base[state.map[b]]
        place = vehicles.position[b, v, 0], vehicles.position[b, v, 1], vehicles.height[b, v]
        lane, hint = vehicles.lane[b, v], agents.route_progress[b, a]
        mask = _BUS_LANES if vehicles.kind[b, v] in (_BUS, _COACH) else _CAR_LANES
        count, left_out = 1, 0
        if is_led(guide, b, a) and lane >= 0:
            write_led_path(roads, routes, guide, b, a, m, place, lane, hint, mask, spacing, paths)
        else:
            number = routes.number[b, a]
            count, left_out = write_waypoints(
                roads, routes, m, place, lane, number, hint, mask, spacing, paths
            )
        out.path_count[b, g], out.left_out[b, g] = count, left_out
        for k in range(len(paths.length)):
            length = paths.length[k] if k < count else 0
            out.waypoint_count[b, g, k] = length
            for w in range(length):
                x, y, heading, on_lane, s = paths.point[k, w]
                number = int(on_lane)
                limit = guide.speed[b, a] if guide.speed[b, a] > 0.0 else roads.lane_speed[number]
                write_waypoint(roads, base, number, s, (x, y, heading), limit, (b, g, k, w), out)
            clear_waypoints(out, b, g, k, length)

    @staticmethod
    def as_object(readings: Readings, seen: Seen) -> list[list[Waypoint]]:
        """Return the paths, from the right to the left."""
        counts = readings["waypoint_count"][: int(readings["path_count"])].tolist()
        return [waypoints_of(readings, seen, path, count) for path, count in enumerate(counts)]
