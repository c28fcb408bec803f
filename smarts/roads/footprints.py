"""Kernels that test whether points and the corners of footprints are on the road."""

from __future__ import annotations

import math

from smarts.geometry.compiling import kernel
from smarts.geometry.segments import inside_outline
from smarts.roads.arrays import Roads
from smarts.roads.kernels import END_TOLERANCE, cell_at, is_level, is_somewhere, nearest_in_run, place_on

JOINT = 0.3
"""A point this far beyond the ends of two lanes is between them [m]: 10 degrees at 1.6 m from the middle."""
SEAM = 0.05
"""A point this far beyond the sides of two lanes of a road is between them [m]: in bends, lanes side by side
do not touch everywhere, since their centrelines are polylines."""
LANE_GAP = 0.15
"""A point this far beyond the sides of two lanes, but not beyond their ends, is between them, too, outside of
junctions [m]: until 2016, netconvert left 0.1 m between lanes (`SUMO_const_laneOffset`)."""


@kernel
def is_on_road(
    roads: Roads, world: int, x: float, y: float, height: float, mask: int, junctions: bool, likely: int = -1
) -> bool:
    """Return whether a point lies on a lane of the masked kinds or, with `junctions`, in a junction.

    Only roads near `height` [m] count. `likely` is one of these lanes on which it may be, to be
    quick; -1 for none.

    Where two consecutive lanes meet at an angle, the wedge between their ends is road, too, and so is the
    crack between two lanes side by side in a bend, or between any two lanes of an old map.
    """
    cell = cell_at(roads, world, x, y) if is_somewhere(x, y) else -1
    if cell < 0:
        return False
    if likely >= 0 and _is_on_lane(roads, cell, likely, x, y, height):
        return True
    ends, beside = 0, -1
    for run in range(roads.run_start[cell], roads.run_start[cell + 1]):
        lane = roads.run[run, 0]
        if mask >> roads.lane_kind[lane] & 1:
            point, square = nearest_in_run(roads, run, x, y, height)
            half = 0.5 * roads.lane_width[lane]
            if square <= half * half:
                overshoot = place_on(roads, lane, point, x, y)[2]
                ends += overshoot < JOINT
                if overshoot <= END_TOLERANCE or ends == 2:
                    return True
            elif square <= (half + SEAM) ** 2:
                if beside >= 0 and (roads.lane_left[lane] == beside or roads.lane_right[lane] == beside):
                    return True
                beside = lane
    if junctions and _is_in_junction(roads, cell, x, y, height):
        return True
    return _is_in_gap(roads, cell, x, y, height, mask)


@kernel
def _is_on_lane(roads: Roads, cell: int, lane: int, x: float, y: float, height: float) -> bool:
    for run in range(roads.run_start[cell], roads.run_start[cell + 1]):
        if roads.run[run, 0] == lane:
            point, square = nearest_in_run(roads, run, x, y, height)
            half = 0.5 * roads.lane_width[lane]
            if square <= half * half and place_on(roads, lane, point, x, y)[2] <= END_TOLERANCE:
                return True
    return False


@kernel
def _is_in_junction(roads: Roads, cell: int, x: float, y: float, height: float) -> bool:
    for entry in range(roads.outline_start[cell], roads.outline_start[cell + 1]):
        outline = roads.outline[entry]
        first, last = roads.vertex_start[outline], roads.vertex_start[outline + 1]
        is_near = is_level(roads.outline_z[outline], height)
        if is_near and inside_outline(x, y, roads.vertex, first, last):
            return True
    return False


@kernel
def _is_in_gap(roads: Roads, cell: int, x: float, y: float, height: float, mask: int) -> bool:
    """Return whether a point off all lanes is between two of one road, or of its two directions."""
    beside = -1
    for run in range(roads.run_start[cell], roads.run_start[cell + 1]):
        lane = roads.run[run, 0]
        if roads.lane_inside[lane] or not mask >> roads.lane_kind[lane] & 1:
            continue
        point, square = nearest_in_run(roads, run, x, y, height)
        is_near = square <= (0.5 * roads.lane_width[lane] + LANE_GAP) ** 2
        if is_near and place_on(roads, lane, point, x, y)[2] <= END_TOLERANCE:
            if beside >= 0 and _are_neighbors(roads, lane, beside):
                return True
            beside = lane
    return False


@kernel
def _are_neighbors(roads: Roads, lane: int, other: int) -> bool:
    """Return whether two lanes are side by side, in the same direction or in opposite ones."""
    if roads.lane_left[lane] == other or roads.lane_right[lane] == other:
        return True
    return roads.lane_twin[lane] == other or roads.lane_twin[other] == lane


@kernel
def count_corners_on_road(
    roads: Roads,
    world: int,
    x: float,
    y: float,
    height: float,
    heading: float,
    length: float,
    width: float,
    mask: int,
    junctions: bool,
    likely: int = -1,
) -> int:
    """Return how many of one footprint's four corners are on the road; see `is_on_road`."""
    forward_x, forward_y = math.cos(heading), math.sin(heading)
    count = 0
    for corner in range(4):
        ahead = length * (0.5 if corner < 2 else -0.5)
        aside = width * (0.5 if corner % 2 else -0.5)
        corner_x = x + ahead * forward_x - aside * forward_y
        corner_y = y + ahead * forward_y + aside * forward_x
        count += is_on_road(roads, world, corner_x, corner_y, height, mask, junctions, likely)
    return count
