"""The paths ahead of the agent's vehicle."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import numpy as np

from smarts.agents.options import Waypoints
from smarts.arrays import Floats, Ints, Singles
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.guide import is_led, write_led_path
from smarts.roads.lane_graph import LaneKind
from smarts.roads.scene import Scene
from smarts.roads.waypoints import WaypointPaths, write_waypoints
from smarts.sensors.bounds import FARTHEST, FASTEST, LARGEST_BOX, MOST, clipped, clipped_above
from smarts.sensors.protocol import KernelSensor, Readings, Seen
from smarts.sensors.waypoint import Waypoint, clear_waypoints, waypoint_fields, waypoints_of
from smarts.types.interface import Field
from smarts.types.vehicles import VehicleKind
from smarts.types.world import State

_CAR_LANES = 1 << LaneKind.CAR
_BUS_LANES = 1 << LaneKind.CAR | 1 << LaneKind.BUS
_BUS, _COACH = int(VehicleKind.BUS), int(VehicleKind.COACH)


class _Out(NamedTuple):
    """Shape (B, G, ...), K paths of W waypoints each."""

    path_count: Ints
    left_out: Ints
    waypoint_count: Ints
    position: Floats
    heading: Singles
    lane_width: Singles
    speed_limit: Singles
    lane: Ints
    lane_index: Ints
    lane_offset: Singles


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
        shape = (1, self.option.paths, self.option.lookahead)
        paths = WaypointPaths.allocate(*shape)
        return scene.routes.number, float(self.option.spacing), paths, np.empty(1)

    @staticmethod
    @kernel
    def write(
        state: State,
        roads: Roads,
        routes: RouteTable,
        b: int,
        g: int,
        a: int,
        out: _Out,
        route: Ints,
        spacing: float,
        paths: WaypointPaths,
        hint: Floats,
    ) -> None:
        """Write an agent's readings; see `KernelSensor`."""
        vehicles, agents, guide = state.vehicles, state.agents, state.guidance
        v = agents.slot[b, a]
        hint[0] = agents.route_progress[b, a]
        lane, kind = vehicles.lane[b, v], vehicles.kind[b, v]
        mask = _BUS_LANES if kind in (_BUS, _COACH) else _CAR_LANES
        if is_led(guide, b, a) and lane >= 0:
            write_led_path(
                roads,
                routes,
                guide,
                b,
                a,
                state.map[b],
                (vehicles.position[b, v, 0], vehicles.position[b, v, 1], vehicles.height[b, v], lane),
                route[b, a],
                hint[0],
                mask,
                spacing,
                paths,
            )
        else:
            write_waypoints(
                roads,
                routes,
                state.map[b : b + 1],
                vehicles.position[b, v : v + 1],
                vehicles.height[b, v : v + 1],
                vehicles.lane[b, v : v + 1],
                route[b, a : a + 1],
                hint,
                mask,
                spacing,
                paths,
            )
        if guide.speed[b, a] > 0.0:
            paths.speed_limit[:] = guide.speed[b, a]
        _copy(paths, out, b, g)

    @staticmethod
    def as_object(readings: Readings, seen: Seen) -> list[list[Waypoint]]:
        """Return the paths, from the right to the left."""
        counts = readings["waypoint_count"][: int(readings["path_count"])].tolist()
        return [waypoints_of(readings, seen, path, count) for path, count in enumerate(counts)]


@kernel
def _copy(paths: WaypointPaths, out: _Out, b: int, g: int) -> None:
    """Copy one vehicle's paths into its readings, within their bounds."""
    count = paths.path_count[0]
    out.path_count[b, g], out.left_out[b, g] = count, paths.left_out[0]
    for k in range(out.heading.shape[2]):
        length = paths.waypoint_count[0, k] if k < count else 0
        out.waypoint_count[b, g, k] = length
        for w in range(length):
            out.position[b, g, k, w, 0] = clipped(paths.position[0, k, w, 0], FARTHEST)
            out.position[b, g, k, w, 1] = clipped(paths.position[0, k, w, 1], FARTHEST)
            out.heading[b, g, k, w] = clipped(paths.heading[0, k, w], math.pi)
            out.lane_width[b, g, k, w] = clipped_above(paths.width[0, k, w], LARGEST_BOX)
            out.speed_limit[b, g, k, w] = clipped_above(paths.speed_limit[0, k, w], FASTEST)
            out.lane[b, g, k, w] = paths.lane[0, k, w]
            out.lane_index[b, g, k, w] = paths.lane_index[0, k, w]
            out.lane_offset[b, g, k, w] = clipped_above(paths.lane_offset[0, k, w], FARTHEST)
        clear_waypoints(out, b, g, k, length)
