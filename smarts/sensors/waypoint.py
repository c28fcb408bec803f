"""Waypoints as objects, for the sensors that report some."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from smarts.arrays import Floats
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads
from smarts.sensors.bounds import FARTHEST, FASTEST, LARGEST_BOX, MOST, clipped, clipped_above
from smarts.sensors.protocol import Readings, Seen
from smarts.types.coordinates import Heading
from smarts.types.interface import Field


class Waypoint(NamedTuple):
    """A point on the centreline of a lane."""

    pos: Floats
    """[m], shape (2,)."""
    heading: Heading
    lane_id: str
    lane_width: float
    """[m]"""
    speed_limit: float
    """[m/s]"""
    lane_index: int
    """0 is the rightmost."""
    lane_offset: float
    """Along the lane from its begin [m]."""

    @property
    def pose(self) -> tuple[float, float, float]:
        """Return x, y [m] and heading [rad]."""
        return float(self.pos[0]), float(self.pos[1]), float(self.heading)

    def relative_heading(self, heading: float) -> Heading:
        """Return how far the waypoint points to the left of a heading [rad]."""
        return Heading(self.heading - heading)

    def signed_lateral_error(self, position: Floats | tuple[float, ...]) -> float:
        """Return how far to the left of the waypoint's line a position is [m]."""
        x, y = position[0] - self.pos[0], position[1] - self.pos[1]
        return float(y * math.cos(self.heading) - x * math.sin(self.heading))

    def dist_to(self, position: Floats | tuple[float, ...]) -> float:
        """Return the distance to a position [m]."""
        return math.hypot(position[0] - self.pos[0], position[1] - self.pos[1])


def waypoint_fields(paths: int, waypoints: int) -> tuple[Field, ...]:
    """Return the fields of some paths of so many waypoints each."""
    shape, single, far = (paths, waypoints), np.float32, FARTHEST
    return (
        Field("position", (*shape, 2), np.float64, -far, far, "m", "on the lane's centreline"),
        Field("heading", shape, single, -np.pi, np.pi, "rad", "of the centreline"),
        Field("lane_width", shape, single, 0, LARGEST_BOX, "m", ""),
        Field("speed_limit", shape, single, 0, FASTEST, "m/s", ""),
        Field("lane", shape, np.int32, 0, MOST, "", "number in the map"),
        Field("lane_index", shape, np.int32, 0, MOST, "", "place across the road, 0 is the rightmost"),
        Field("lane_offset", shape, single, 0, far, "m", "along the lane from its begin"),
    )


@kernel
def write_waypoint(
    roads: Roads,
    base: int,
    lane: int,
    s: float,
    pose: tuple[float, float, float],
    limit: float,
    place: tuple[int, int, int, int],
    out: Any,
) -> None:
    """Write a waypoint at a lane's `s` [m], x, y [m], heading [rad], to simulation, agent, path, number."""
    out.position[place][0], out.position[place][1] = clipped(pose[0], FARTHEST), clipped(pose[1], FARTHEST)
    out.heading[place] = clipped(pose[2], math.pi)
    out.lane_width[place] = clipped_above(roads.lane_width[lane], LARGEST_BOX)
    out.speed_limit[place] = clipped_above(limit, FASTEST)
    out.lane[place], out.lane_index[place] = lane - base, roads.lane_index[lane]
    out.lane_offset[place] = clipped_above(s, FARTHEST)


@kernel
def clear_waypoints(out: Any, b: int, g: int, k: int, first: int) -> None:
    """Write 0 into an agent's waypoints in row `k` from number `first` on.

    Args:
        out: A named tuple of the waypoints' arrays, shape (B, G, K, W, ...); written.
        b: The simulation.
        g: The agent.
        k: The path or lane.
        first: The first waypoint.
    """
    out.position[b, g, k, first:] = 0.0
    out.heading[b, g, k, first:] = 0.0
    out.lane_width[b, g, k, first:] = 0.0
    out.speed_limit[b, g, k, first:] = 0.0
    out.lane[b, g, k, first:] = 0
    out.lane_index[b, g, k, first:] = 0
    out.lane_offset[b, g, k, first:] = 0.0


def waypoints_of(readings: Readings, seen: Seen, path: int, count: int) -> list[Waypoint]:
    """Return the first waypoints of a path, out of arrays of shape (paths, waypoints, ...)."""
    names = ("heading", "lane", "lane_width", "speed_limit", "lane_index", "lane_offset")
    # One conversion of each array: single numbers of arrays are slow.
    columns = (readings[name][path, :count].tolist() for name in names)
    lane_ids = seen.graph.lane_ids
    return [
        Waypoint(position, Heading(heading), lane_ids[lane], *others)
        for position, heading, lane, *others in zip(readings["position"][path, :count], *columns, strict=True)
    ]
