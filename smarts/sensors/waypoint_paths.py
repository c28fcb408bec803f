"""The paths ahead of the agent's vehicle."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smarts.agents.options import Waypoints
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.guide import is_led, write_led_path
from smarts.roads.lane_graph import LaneKind
from smarts.roads.scene import Scene
from smarts.roads.waypoints import WaypointPaths, write_waypoints
from smarts.sensors.bounds import FARTHEST, FASTEST, LARGEST_BOX, MOST, clipped, clipped_above
from smarts.types.guidance import Guidance
from smarts.types.interface import Field
from smarts.types.vehicles import VehicleKind

Bools = NDArray[np.bool_]
Bytes = NDArray[np.int8]
Ints = NDArray[np.int32]
Floats = NDArray[np.float64]
Singles = NDArray[np.float32]

_CAR_LANES = 1 << LaneKind.CAR
_BUS_LANES = 1 << LaneKind.CAR | 1 << LaneKind.BUS
_BUS, _COACH = int(VehicleKind.BUS), int(VehicleKind.COACH)


class _Entries(NamedTuple):
    """The arrays to be filled, shape (B, G, ...), K paths of W waypoints each."""

    path_count: Ints
    waypoint_count: Ints
    position: Floats
    heading: Singles
    lane_width: Singles
    speed_limit: Singles
    lane: Ints
    lane_index: Ints
    lane_offset: Singles


@dataclass(frozen=True)
class WaypointPathsAhead:
    """A path for each lane of the road that the vehicle may use, from the right to the left, along the route.

    `smarts.roads.waypoints.WaypointPaths` says how paths run, branch and end. An agent that its mission's
    task leads (`smarts.types.guidance`) gets one path instead: its lane as far as the manoeuvre, then the
    curve into the other lane. Where the task says how fast to drive, that is every waypoint's limit.
    """

    option: Waypoints = field(default_factory=Waypoints)

    def fields(self) -> tuple[Field, ...]:
        """Return what is reported."""
        k, w = self.option.paths, self.option.lookahead
        return (
            Field("path_count", (), np.int32, 0, k, "", "how many paths there are; the others are 0"),
            Field(
                "waypoint_count", (k,), np.int32, 0, w, "", "waypoints of each path; those after them are 0"
            ),
            Field("position", (k, w, 2), np.float64, -FARTHEST, FARTHEST, "m", "on the lane's centreline"),
            Field("heading", (k, w), np.float32, -np.pi, np.pi, "rad", "of the centreline"),
            Field("lane_width", (k, w), np.float32, 0, LARGEST_BOX, "m", ""),
            Field("speed_limit", (k, w), np.float32, 0, FASTEST, "m/s", ""),
            Field("lane", (k, w), np.int32, 0, MOST, "", "number in the map"),
            Field("lane_index", (k, w), np.int32, 0, MOST, "", "place across the road, 0 is the rightmost"),
            Field("lane_offset", (k, w), np.float32, 0, FARTHEST, "m", "along the lane from its begin"),
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
            world.vehicles.kind,
            world.vehicles.position,
            world.vehicles.lane,
            world.guidance,
            self.option.spacing,
            _Entries(**{name: out[name] for name in _Entries._fields}),
        )


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
    kind: Bytes,
    position: Floats,
    lane: Ints,
    guide: Guidance,
    spacing: float,
    entries: _Entries,
) -> None:
    most, lookahead = entries.heading.shape[2], entries.heading.shape[3]
    shape = (1, most, lookahead)
    paths = WaypointPaths(
        np.zeros(1, np.int32),
        np.zeros((1, most), np.int32),
        np.zeros((1, most, lookahead, 2)),
        np.zeros(shape),
        np.zeros(shape),
        np.zeros(shape),
        np.zeros(shape, np.int32),
        np.zeros(shape, np.int32),
        np.zeros(shape),
    )
    hint = np.empty(1)
    for b in range(observe_mask.shape[0]):
        for g in range(observe_mask.shape[1]):
            if not observe_mask[b, g]:
                continue
            a = agent_ids[g]
            v = slots[b, a]
            hint[0] = route_progress[b, a]
            mask = _BUS_LANES if kind[b, v] == _BUS or kind[b, v] == _COACH else _CAR_LANES
            if is_led(guide, b, a) and lane[b, v] >= 0:
                write_led_path(
                    roads,
                    table,
                    guide,
                    b,
                    a,
                    maps[b],
                    (position[b, v, 0], position[b, v, 1], lane[b, v]),
                    route[b, a],
                    route_progress[b, a],
                    mask,
                    spacing,
                    paths,
                )
            else:
                write_waypoints(
                    roads,
                    table,
                    maps[b : b + 1],
                    position[b, v : v + 1],
                    lane[b, v : v + 1],
                    route[b, a : a + 1],
                    hint,
                    mask,
                    spacing,
                    paths,
                )
            if guide.speed[b, a] > 0.0:
                paths.speed_limit[:] = guide.speed[b, a]
            _copy(paths, entries, b, g)


@kernel
def _copy(paths: WaypointPaths, entries: _Entries, b: int, g: int) -> None:
    """Copy one vehicle's paths into its entries, within their bounds."""
    count = paths.path_count[0]
    entries.path_count[b, g] = count
    for k in range(entries.heading.shape[2]):
        length = paths.waypoint_count[0, k] if k < count else 0
        entries.waypoint_count[b, g, k] = length
        for w in range(length):
            entries.position[b, g, k, w, 0] = clipped(paths.position[0, k, w, 0], FARTHEST)
            entries.position[b, g, k, w, 1] = clipped(paths.position[0, k, w, 1], FARTHEST)
            entries.heading[b, g, k, w] = clipped(paths.heading[0, k, w], math.pi)
            entries.lane_width[b, g, k, w] = clipped_above(paths.width[0, k, w], LARGEST_BOX)
            entries.speed_limit[b, g, k, w] = clipped_above(paths.speed_limit[0, k, w], FASTEST)
            entries.lane[b, g, k, w] = paths.lane[0, k, w]
            entries.lane_index[b, g, k, w] = paths.lane_index[0, k, w]
            entries.lane_offset[b, g, k, w] = clipped_above(paths.lane_offset[0, k, w], FARTHEST)
        entries.position[b, g, k, length:] = 0.0
        entries.heading[b, g, k, length:] = 0.0
        entries.lane_width[b, g, k, length:] = 0.0
        entries.speed_limit[b, g, k, length:] = 0.0
        entries.lane[b, g, k, length:] = 0
        entries.lane_index[b, g, k, length:] = 0
        entries.lane_offset[b, g, k, length:] = 0.0
