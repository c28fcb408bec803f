"""The areas that zones cover, as shapely geometries in the map frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from shapely import affinity, ops
from shapely.geometry import LineString, Polygon, box
from shapely.geometry.base import BaseGeometry

from smarts.roads.lane_graph import LaneGraph
from smarts.sstudio.sstypes.constants import BASE_OFFSET, MAX_OFFSET, RANDOM_OFFSET
from smarts.sstudio.sstypes.drawing import drawing

SEAM = 0.3
"""Excess width of a lane's strip, so that neighbouring strips overlap [m]."""


def polygon(corners: Sequence[tuple[float, float]], rotation: float) -> Polygon:
    """Return the polygon of the corners, or the rectangle that two corners span, turned about its middle."""
    flat = [corner[:2] for corner in corners]
    if len(flat) == 2:
        (left, low), (right, high) = flat
        shape = box(min(left, right), min(low, high), max(left, right), max(low, high))
    else:
        shape = Polygon(flat)
    return affinity.rotate(shape, rotation, origin="center", use_radians=True) if rotation else shape


def lane_strips(
    roads: LaneGraph, start: tuple[str, int, Any], length: float | str, n_lanes: int
) -> BaseGeometry:
    """Return a stretch of neighbouring lanes as one area; the arguments are those of a `MapZone`.

    Raises:
        MapError: The edge or one of the lanes is not on the map.
    """
    edge, first, offset = start
    lanes = [roads.lane_number(edge, first + place) for place in range(n_lanes)]
    if offset == RANDOM_OFFSET:
        room = min(float(roads.sumo_length[lane]) - _length(roads, lane, length) for lane in lanes)
        offset = drawing().generator.uniform(0.0, room)
    return ops.unary_union([_strip(roads, lane, offset, length) for lane in lanes])


def _length(roads: LaneGraph, lane: int, wanted: float | str) -> float:
    whole = float(roads.sumo_length[lane])
    return whole if wanted == MAX_OFFSET else min(float(wanted), whole)


def _strip(roads: LaneGraph, lane: int, offset: float | str, wanted: float | str) -> BaseGeometry:
    """Return the part of a lane that begins at `offset` and is `wanted` [m] long, or shorter at its end.

    Both are SUMO's lengths, as all offsets of scenarios are.
    """
    whole, length = float(roads.sumo_length[lane]), _length(roads, lane, wanted)
    named = {BASE_OFFSET: 0.0, MAX_OFFSET: whole - length}
    begin = named[offset] if isinstance(offset, str) else float(offset)
    first, last = (roads.arc_length(lane, position) for position in (begin, min(begin + length, whole)))
    centre = ops.substring(LineString(roads.centreline(lane)), first, last)
    return centre.buffer((float(roads.width[lane]) + SEAM) / 2, cap_style="flat")
