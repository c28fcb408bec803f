"""Conflicts of lanes inside a junction: pairs that cross or merge, and their extents along each lane."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from smarts.arrays import Bytes, Floats, Ints
from smarts.roads.lane_graph import ConflictKind, LaneKind, Yields

LEAST_OVERLAP = 0.25
"""Lanes that share less area than this only touch, as neighbours in a bend do [m^2]."""
SIMPLIFICATION = 0.01
"""Tolerance of simplified centrelines [m]; fewer points make the search faster."""

_MOTOR_TRAFFIC = (LaneKind.CAR, LaneKind.BUS)


@dataclass(frozen=True)
class LaneAreas:
    """The areas of L lanes: lane i covers its centreline widened to `width[i]`."""

    centrelines: list[Floats]
    width: Floats
    junction: Ints
    """Junction that the lane lies in, -1 for road lanes."""
    kind: Bytes
    origin: Ints
    """Road lane from which the junction is entered on this lane, -1 where there is none or several."""
    target: Ints
    """Road lane into which this lane leads in the end."""
    gives_way: Mapping[int, frozenset[int]]
    """The lanes to whose traffic a lane's has to give way; lanes that give way to none may be left out."""


@dataclass(frozen=True)
class Conflicts:
    """CSR rows, for each lane the others in ascending order; see the same fields of `LaneGraph`."""

    start: Ints
    lane: Ints
    kind: Bytes
    yields: Bytes
    extent: Floats
    other_extent: Floats


def find_conflicts(areas: LaneAreas) -> Conflicts:
    """Return all pairs of lanes of one junction whose areas overlap, each pair in both directions.

    Lanes that come from the same road lane diverge instead: the follower reacts to its leader, and no pair
    is reported. Lanes for bicycles and pedestrians are left out.
    """
    inside = np.flatnonzero((areas.junction >= 0) & np.isin(areas.kind, _MOTOR_TRAFFIC))
    lines = np.array([shapely.LineString(areas.centrelines[lane]) for lane in inside], object)
    lines = shapely.simplify(lines, SIMPLIFICATION)
    shapes = shapely.buffer(lines, areas.width[inside] / 2, cap_style="flat", join_style="mitre")
    a, b = _candidates(areas, inside, shapes)
    overlap = shapely.intersection(shapes[a], shapes[b])
    kept = shapely.area(overlap) > LEAST_OVERLAP
    a, b, overlap = a[kept], b[kept], overlap[kept]
    extent, other_extent = _extent(lines[a], overlap), _extent(lines[b], overlap)
    return _both_directions(inside[a], inside[b], extent, other_extent, areas)


def _candidates(areas: LaneAreas, inside: NDArray[np.intp], shapes: NDArray) -> tuple[NDArray, NDArray]:
    a, b = shapely.STRtree(shapes).query(shapes, predicate="intersects")
    first, second = inside[a], inside[b]
    # Roads on a bridge overlap in the plane with those below, but never within one junction.
    same_junction = areas.junction[first] == areas.junction[second]
    diverge = (areas.origin[first] == areas.origin[second]) & (areas.origin[first] >= 0)
    kept = (first < second) & same_junction & ~diverge
    return a[kept], b[kept]


def _extent(lines: NDArray, overlap: NDArray) -> Floats:
    """Return the first and the last arc length [m] of each line beside its overlap, shape (., 2)."""
    points, owner = shapely.get_coordinates(overlap, return_index=True)
    stations = shapely.line_locate_point(lines[owner], shapely.points(points))
    extent = np.empty((len(lines), 2))
    extent[:, 0], extent[:, 1] = np.inf, -np.inf
    np.minimum.at(extent[:, 0], owner, stations)
    np.maximum.at(extent[:, 1], owner, stations)
    return extent


def _both_directions(a: NDArray, b: NDArray, extent: Floats, other: Floats, areas: LaneAreas) -> Conflicts:
    merge = (areas.target[a] == areas.target[b]) & (areas.target[a] >= 0)
    kind = np.where(merge, ConflictKind.MERGE, ConflictKind.CROSS).astype(np.int8)
    lane, partner = np.concatenate((a, b)), np.concatenate((b, a))
    order = np.lexsort((partner, lane))
    counts = np.bincount(lane, minlength=len(areas.width))
    yields = [
        _yields(areas, *pair) for pair in zip(lane[order].tolist(), partner[order].tolist(), strict=True)
    ]
    return Conflicts(
        start=np.concatenate(([0], np.cumsum(counts))).astype(np.int32),
        lane=partner[order].astype(np.int32),
        kind=np.tile(kind, 2)[order],
        yields=np.array(yields, np.int8),
        extent=np.concatenate((extent, other))[order],
        other_extent=np.concatenate((other, extent))[order],
    )


def _yields(areas: LaneAreas, lane: int, other: int) -> int:
    this_waits = other in areas.gives_way.get(lane, ())
    other_waits = lane in areas.gives_way.get(other, ())
    return Yields.THIS * this_waits + Yields.OTHER * other_waits
