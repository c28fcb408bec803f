"""Outlines of bubbles as arrays, and where a way leads relative to them."""

from __future__ import annotations

import enum
import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from smarts.arrays import Bools, Floats, Ints
from smarts.geometry.compiling import kernel
from smarts.geometry.rings import inside_rings, starts_of
from smarts.types.bubbles import PlacedBubble


class Place(enum.IntEnum):
    """Where a point is relative to a bubble."""

    OUTSIDE = 0
    MARGIN = 1
    ZONE = 2


_OUTSIDE, _MARGIN, _ZONE = int(Place.OUTSIDE), int(Place.MARGIN), int(Place.ZONE)


class BubbleTable(NamedTuple):
    """N bubbles; rings of each are consecutive, first those of the zone, then those of zone and margin.

    Rings are closed: the last point is the first.

    Coordinates are those of the scenario's file. A bubble that moves has a pose (x, y, turn): it is turned
    about the origin, then shifted.
    """

    points: Floats
    """Points of all rings [m], shape (P, 2)."""
    ring_start: Ints
    """First point of each ring, shape (R + 1,)."""
    first_ring: Ints
    """First ring of each bubble's zone, shape (N + 1,)."""
    first_margin: Ints
    """First ring of each bubble's zone with its margin, shape (N,)."""
    box: Floats
    """Bounds of each bubble with its margin: least x and y, largest x and y [m], shape (N, 4)."""
    heights: Floats
    """Least and largest height of its road [m], shape (N, 2)."""
    moves: Bools
    """Whether the bubble follows a vehicle, shape (N,)."""
    anchor: Floats
    """The point of a bubble that moves which lies at the followed vehicle's centre, shape (N, 2)."""
    learns: Bools
    """Whether the learning agents drive in it, shape (N,)."""


def bubble_table(bubbles: Iterable[PlacedBubble]) -> BubbleTable:
    """Return bubbles as arrays."""
    bubbles = [*bubbles]
    rings = [ring for bubble in bubbles for ring in (*bubble.zone, *bubble.margin)]
    first_ring = starts_of([len(bubble.zone) + len(bubble.margin) for bubble in bubbles])
    return BubbleTable(
        points=np.concatenate([np.zeros((0, 2)), *rings]),
        ring_start=starts_of([len(ring) for ring in rings]),
        first_ring=first_ring,
        first_margin=first_ring[:-1] + np.array([len(bubble.zone) for bubble in bubbles], np.int32),
        box=np.array([_bounds(bubble.margin) for bubble in bubbles]).reshape(-1, 4),
        heights=np.array([bubble.heights for bubble in bubbles]).reshape(-1, 2),
        moves=np.array([bool(bubble.followed) for bubble in bubbles], np.bool_),
        anchor=np.array(
            [np.subtract(bubble.centroid, bubble.follow_offset) for bubble in bubbles], np.float64
        ).reshape(-1, 2),
        learns=np.array([bubble.policy < 0 for bubble in bubbles], np.bool_),
    )


def _bounds(rings: Sequence[Floats]) -> Floats:
    points = np.concatenate(rings)
    return np.concatenate([points.min(0), points.max(0)])


@kernel
def bubble_pose(
    table: BubbleTable, number: int, x: float, y: float, heading: float
) -> tuple[float, float, float]:
    """Return the pose (x, y, turn) of a bubble whose followed vehicle is at x, y [m] with a heading [rad].

    Offsets are given for a vehicle that faces north.
    """
    turn = heading - 0.5 * math.pi
    cos, sin = math.cos(turn), math.sin(turn)
    ax, ay = table.anchor[number]
    return x - (cos * ax - sin * ay), y - (sin * ax + cos * ay), turn


@kernel
def place_of(table: BubbleTable, number: int, x: float, y: float) -> int:
    """Return the `Place` of a point in a bubble's coordinates."""
    box = table.box[number]
    if x < box[0] or y < box[1] or x > box[2] or y > box[3]:
        return _OUTSIDE
    first, margin, last = table.first_ring[number], table.first_margin[number], table.first_ring[number + 1]
    if _inside(table, first, margin, x, y):
        return _ZONE
    return _MARGIN if _inside(table, margin, last, x, y) else _OUTSIDE


@kernel
def deepest_on(table: BubbleTable, number: int, x: float, y: float, to_x: float, to_y: float) -> int:
    """Return the deepest `Place` on the straight way between two points in a bubble's coordinates."""
    box = table.box[number]
    is_off = max(x, to_x) < box[0] or max(y, to_y) < box[1] or min(x, to_x) > box[2] or min(y, to_y) > box[3]
    if is_off:
        return _OUTSIDE
    first, margin, last = table.first_ring[number], table.first_margin[number], table.first_ring[number + 1]
    if _inside(table, first, margin, x, y) or _inside(table, first, margin, to_x, to_y):
        return _ZONE
    if _crosses(table, first, margin, x, y, to_x, to_y):
        return _ZONE
    if _inside(table, margin, last, x, y) or _inside(table, margin, last, to_x, to_y):
        return _MARGIN
    return _MARGIN if _crosses(table, margin, last, x, y, to_x, to_y) else _OUTSIDE


@kernel
def _inside(table: BubbleTable, first: int, last: int, x: float, y: float) -> bool:
    """Return whether a point is inside an odd number of rings."""
    return inside_rings(x, y, table.points, table.ring_start, first, last)


@kernel
def _crosses(table: BubbleTable, first: int, last: int, x: float, y: float, to_x: float, to_y: float) -> bool:
    """Return whether a way touches a side of a ring."""
    dx, dy = to_x - x, to_y - y
    for ring in range(first, last):
        begin, end = table.ring_start[ring], table.ring_start[ring + 1]
        before = end - 1
        for point in range(begin, end):
            ax, ay = table.points[before, 0], table.points[before, 1]
            bx, by = table.points[point, 0], table.points[point, 1]
            before = point
            # The ends of each of the two segments are on different sides of the other.
            from_a = dx * (ay - y) - dy * (ax - x)
            from_b = dx * (by - y) - dy * (bx - x)
            ex, ey = bx - ax, by - ay
            from_begin = ex * (y - ay) - ey * (x - ax)
            from_end = ex * (to_y - ay) - ey * (to_x - ax)
            if from_a * from_b <= 0.0 and from_begin * from_end < 0.0:
                return True
    return False
