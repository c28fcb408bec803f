"""Kernels that find where a vehicle can make a U-turn into an opposite lane, over road all the way."""

from __future__ import annotations

import math

import numpy as np

from smarts.arrays import Floats
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import segment_at
from smarts.roads.arrays import Roads
from smarts.roads.atlas import ROAD_LANES
from smarts.roads.curves import PIECES, curve_into, pose_on
from smarts.roads.footprints import count_corners_on_road, is_on_road
from smarts.roads.kernels import centre_at, height_at, lane_length, pose_on_lane
from smarts.roads.lane_graph import OPPOSITE
from smarts.roads.waypoints import foot

SPACING = 1.0
"""Distance between the places that are tried [m]."""
_ROAD = sum(1 << kind for kind in ROAD_LANES)


@kernel
def is_opposite(roads: Roads, heading: float, lane: int, s: float) -> bool:
    """Return whether a lane's direction at arc length `s` [m] is opposite to `heading` [rad]."""
    return bool(np.cos(pose_on_lane(roads, lane, s)[2] - heading) <= OPPOSITE)


@kernel
def is_over_road(roads: Roads, world: int, control: Floats, height: float) -> bool:
    """Return whether a curve with these control points stays on a map's lanes and junctions near a height."""
    for i in range(PIECES + 1):
        x, y, _ = pose_on(control, i / PIECES)
        if not is_on_road(roads, world, x, y, height, _ROAD, True):
            return False
    return True


@kernel
def is_footprint_over_road(
    roads: Roads, world: int, control: Floats, height: float, length: float, width: float
) -> bool:
    """Return whether a footprint whose centre follows a curve stays on lanes and junctions near a height."""
    for i in range(PIECES + 1):
        x, y, heading = pose_on(control, i / PIECES)
        if count_corners_on_road(roads, world, x, y, height, heading, length, width, _ROAD, True) < 4:
            return False
    return True


@kernel
def can_turn_round(roads: Roads, world: int, lane: int, back: int, begin: float) -> bool:
    """Return whether a vehicle can turn into another lane somewhere on a lane, from `begin` [m] on."""
    return place_to_turn(roads, world, lane, back, begin, lane_length(roads, lane)) >= 0.0


@kernel
def place_to_turn(roads: Roads, world: int, lane: int, back: int, begin: float, end: float) -> float:
    """Return the first arc length on a lane where a vehicle can turn into another lane [m], -1 without one.

    Args:
        roads: The maps' lanes.
        world: The map.
        lane: The lane before the turn.
        back: The lane after it.
        begin: First arc length to try [m].
        end: Last arc length to try [m]; at most the lane's length.
    """
    pose = np.empty(3)
    last = min(end, lane_length(roads, lane))
    for i in range(math.floor((last - begin) / SPACING) + 1):
        s = begin + i * SPACING
        point = segment_at(roads.point_s, roads.point_start[lane], roads.point_start[lane + 1], s)
        pose[0], pose[1], pose[2] = centre_at(roads, point, s)
        height = height_at(roads, point, s)
        beside = foot(roads, back, pose[0], pose[1], height)
        if not 0.0 < beside < lane_length(roads, back) or not is_opposite(roads, pose[2], back, beside):
            continue
        if is_over_road(roads, world, curve_into(roads, pose, back, beside), height):
            return s
    return -1.0
