"""Places and routes of a scenario on its map: lane, offset and edges.

Offsets of scenarios are SUMO's positions along a lane; arc lengths s of the drawn centreline differ from
them, see `LaneGraph.arc_length`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from smarts.errors import MapError, ScenarioError
from smarts.roads.lane_graph import LaneGraph, LaneKind
from smarts.roads.memory import remembered
from smarts.roads.permissions import roads_for
from smarts.roads.routes import CARS, shortest_route
from smarts.sstudio import sstypes as t
from smarts.sstudio.sstypes.constants import NAMED_OFFSETS, named_offset

Found = TypeVar("Found")

BUSES = CARS | {LaneKind.BUS}
"""The lanes that buses and coaches may use."""


# Missions are placed at every reset, mostly on the same routes.
_shortest_route = remembered(most=1024)(shortest_route)


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


def open_to_all(
    roads: LaneGraph, net: Path, vehicle_classes: Iterable[str], find: Callable[[LaneGraph, str], Found]
) -> Found:
    """Return what is found on the lanes that are open to several vehicle classes of SUMO.

    Args:
        roads: The map.
        net: The network that it was read from.
        vehicle_classes: Such as "truck".
        find: Takes the map as open to them, see `roads_for`, and how errors name them.

    Raises:
        ScenarioError: Raised by `find`, for the first class that finds nothing alone, or for all together.
    """
    classes = sorted(set(vehicle_classes))
    try:
        return find(roads_for(roads, net, classes), named_classes(classes))
    except ScenarioError:
        for each in classes if len(classes) > 1 else ():
            find(roads_for(roads, net, [each]), named_classes([each]))
        raise


def named_classes(vehicle_classes: Sequence[str]) -> str:
    """Return vehicle classes as errors name them."""
    if len(vehicle_classes) == 1:
        return f"vehicles of type '{vehicle_classes[0]}'"
    return f"vehicles of types {' and '.join(map(repr, vehicle_classes))} together"


def open_lane_of(
    roads: LaneGraph,
    place: Sequence[Any],
    where: str,
    kinds: frozenset[LaneKind] = CARS,
    users: str = "this vehicle",
) -> int:
    """Return `lane_of` a place, which has to be on a road and open to the users of `kinds` of lanes.

    Raises:
        ScenarioError: The place is off the map, inside a junction, or closed to them.
    """
    lane = lane_of(roads, place, where)
    if roads.is_internal[lane]:
        raise ScenarioError(
            f"lane '{roads.lane_ids[lane]}' lies inside a junction",
            place=where,
            remedy="choose a lane of a road",
        )
    if roads.kind[lane] not in kinds:
        beside = enumerate(roads.edge_lanes(int(roads.lane_edge[lane])))
        open_lanes = ", ".join(str(index) for index, other in beside if roads.kind[other] in kinds)
        raise ScenarioError(
            f"lane '{roads.lane_ids[lane]}' is closed to {users}",
            place=where,
            remedy=f"lanes of this road that are open: {open_lanes or 'none, use another road or vehicle'}",
        )
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
    roads: LaneGraph,
    route: t.Route,
    where: str,
    vehicle_length: float = 0.0,
    users: str = "the route's vehicles",
) -> tuple[str, ...]:
    """Return the ids of all edges of a route, having checked its places.

    A route that ends behind its begin on the same edge leads round to it.

    Args:
        roads: The map, as open to the vehicle.
        route: The route.
        where: Its place, for errors.
        vehicle_length: Its front bumper starts this far from the lane's begin at least, as far as the lane
            is long enough [m].
        users: The vehicles, for errors.

    Raises:
        ScenarioError: A place is off the map, the begin is closed to the vehicle, or the route cannot be
            driven.
    """
    open_lane_of(roads, route.begin, f"{where}.begin", users=users)
    lane_of(roads, route.end, f"{where}.end")
    back = _distance_back(roads, route, vehicle_length)
    try:
        with blame(where):
            via = tuple(route.via)
            return _shortest_route(roads, route.begin[0], route.end[0], via, lap=back > 0, users=users)
    except ScenarioError as error:
        if not back:
            raise
        raise ScenarioError(
            f"the end lies {back:g} m before the begin on edge '{route.begin[0]}', "
            "and no way leads round to it",
            place=where,
            remedy="exchange begin and end",
        ) from error


def next_lap(
    roads: LaneGraph, lap: tuple[str, ...], where: str, users: str = "the route's vehicles"
) -> tuple[str, ...]:
    """Return the edges of a further lap: those after `lap` up to its end.

    Raises:
        ScenarioError: No way leads back to the first edge.
    """
    first, *others = lap
    if first in others[-1:]:
        return tuple(others)
    with blame(where):
        # From the goal's edge back to the first edge; both belong to the laps.
        return (*_shortest_route(roads, lap[-1], first, lap=True, users=users)[1:-1], *lap)


def _distance_back(roads: LaneGraph, route: t.Route, vehicle_length: float) -> float:
    """Return how far a route ends behind its begin on the same edge, 0 elsewhere [m]; see `route_edges`.

    Random offsets count as what leaves the most way between begin and end.
    """
    if route.begin[0] != route.end[0] or route.via:
        return 0.0
    first, last = (roads.lane_number(*place[:2]) for place in (route.begin, route.end))
    whole = float(roads.sumo_length[first])
    least = min(vehicle_length / roads.arc_length(first, 1.0), whole)
    begin = max(offset_along(route.begin[2], whole, min), least)
    return max(begin - offset_along(route.end[2], float(roads.sumo_length[last]), max), 0.0)


def offset_along(offset: Any, length: float, draw: Callable[[float, float], float]) -> float:
    """Return an offset on a lane of a length, both [m]; `draw` chooses a random one."""
    return named_offset(offset, 0.0, length, draw) if isinstance(offset, str) else offset
