"""Places and routes of a scenario on its map: lane, offset and edges.

Offsets of scenarios are SUMO's positions along a lane; arc lengths s of the drawn centreline differ from
them, see `LaneGraph.arc_length`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from typing import Any

from smarts.errors import MapError, ScenarioError
from smarts.roads.lane_graph import LaneGraph, LaneKind
from smarts.roads.routes import CARS, shortest_route
from smarts.sstudio import sstypes as t
from smarts.sstudio.sstypes.constants import NAMED_OFFSETS

BUSES = CARS | {LaneKind.BUS}
"""The lanes that buses and coaches may use."""


def usable_lanes(vehicle_type: str) -> frozenset[LaneKind]:
    """Return the kinds of lanes that a vehicle type may use."""
    return BUSES if vehicle_type in ("bus", "coach") else CARS


# Missions are placed at every reset, mostly on the same routes.
_shortest_route = lru_cache(maxsize=1024)(shortest_route)


@contextmanager
def blame(where: str) -> Iterator[None]:
    """Turn a MapError into an error of the scenario's object."""
    try:
        yield
    except MapError as error:
        raise ScenarioError(error.problem, place=where, remedy=error.remedy) from error


def lane_of(roads: LaneGraph, place: Sequence[Any], where: str) -> int:
    """Return the row of the lane that (edge, lane index, offset) lies on.

    Raises:
        ScenarioError: The edge or the lane is not on the map, or the offset is off the lane.
    """
    given = [type(part) for part in place] if isinstance(place, list | tuple) else []
    if given[:2] != [str, int] or len(given) != 3:
        raise ScenarioError(
            f"{place!r} is not a place", place=where, remedy="give (edge, lane index, offset)"
        )
    edge, index, offset = place
    with blame(where):
        lane = roads.lane_number(edge, index)
    check_offset(roads, lane, offset, where)
    return lane


def check_offset(roads: LaneGraph, lane: int, offset: Any, where: str) -> None:
    """Raise a ScenarioError unless `offset` is a number on the lane or the name of a place on it."""
    length = float(roads.sumo_length[lane])
    if isinstance(offset, str):
        if offset not in NAMED_OFFSETS:
            names = ", ".join(map(repr, NAMED_OFFSETS))
            raise ScenarioError(
                f"{offset!r} is not an offset", place=where, remedy=f"use a number or {names}"
            )
    elif not isinstance(offset, int | float) or not 0 <= offset <= length:  # NaN, too, is off the lane
        raise ScenarioError(
            f"offset {offset} is off lane '{roads.lane_ids[lane]}', which is {length:.2f} m long",
            place=where,
            remedy=f'use 0 to {math.floor(length * 100) / 100:g}, or "max" for its end',
        )


def via_place(roads: LaneGraph, via: t.Via, where: str) -> tuple[int, float]:
    """Return the row of the lane of a via point and the offset along it [m].

    In a junction an offset may reach into the lane behind a turn's waiting point, because scenarios do not
    know where the map puts that point.

    Raises:
        ScenarioError: The edge or the lane is not on the map, or the offset is off the lane.
    """
    with blame(f"{where}.road_id"):
        edge = (
            via.road_id.to_edge(roads) if isinstance(via.road_id, t.JunctionEdgeIDResolver) else via.road_id
        )
    with blame(f"{where}.lane_index"):
        lane = roads.lane_number(edge, via.lane_index)
    offset = via.lane_offset
    while roads.is_internal[lane] and offset > roads.sumo_length[lane]:
        onward = [int(ahead) for ahead in roads.successors(lane) if roads.is_internal[ahead]]
        if not onward:
            break
        offset, lane = offset - float(roads.sumo_length[lane]), onward[0]
    check_offset(roads, lane, offset, f"{where}.lane_offset")
    return lane, offset


def target_lane(roads: LaneGraph, edge_id: str, task: t.UTurn) -> int:
    """Return the row of the lane that a U-turn leads into."""
    edge = roads.edge_number(edge_id)
    index = min(task.target_lane_index, int(roads.edge_lane_count[edge]) - 1)
    return int(roads.edge_first_lane[edge]) + index


def route_edges(
    roads: LaneGraph, route: t.Route, where: str, kinds: frozenset[LaneKind] = CARS
) -> tuple[str, ...]:
    """Return the ids of all edges of a route, having checked its places.

    Raises:
        ScenarioError: A place is off the map, or the route cannot be driven.
    """
    begin = lane_of(roads, route.begin, f"{where}.begin")
    lane_of(roads, route.end, f"{where}.end")
    if roads.kind[begin] not in kinds:
        raise ScenarioError(
            f"lane '{roads.lane_ids[begin]}' is closed to this vehicle",
            place=f"{where}.begin",
            remedy="choose another lane, or another vehicle_type",
        )
    back = _comes_round(route)
    try:
        with blame(where):
            return _shortest_route(
                roads, route.begin[0], route.end[0], tuple(route.via), lap=back, kinds=kinds
            )
    except ScenarioError as error:
        if not back:
            raise
        raise ScenarioError(
            f"the end lies {route.begin[2] - route.end[2]:g} m before the begin on edge '{route.begin[0]}', "
            "and no way leads round to it",
            place=where,
            remedy="exchange begin and end",
        ) from error


def _comes_round(route: t.Route) -> bool:
    """Return whether a route ends behind its begin on the same edge, so that it must go round once."""
    begin, end = route.begin[2], route.end[2]
    if route.begin[0] != route.end[0] or route.via:
        return False
    return not isinstance(begin, str) and not isinstance(end, str) and end < begin
