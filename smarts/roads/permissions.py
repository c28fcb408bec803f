"""The users of lanes, from SUMO's `allow` and `disallow` lists."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from smarts.roads.lane_graph import LaneGraph, LaneKind
from smarts.roads.memory import remembered

_RAIL = {"rail", "tram", "rail_urban", "rail_electric", "rail_fast", "subway", "cable_car"}
# In order of precedence: a lane is of the first kind of which it is open to some user.
_USERS = (
    (LaneKind.CAR, {"passenger"}),
    (LaneKind.BUS, {"bus", "coach"}),
    (LaneKind.BICYCLE, {"bicycle"}),
    (LaneKind.FOOT, {"pedestrian"}),
    (LaneKind.RAIL, _RAIL),
)


def lane_kind(allow: str, disallow: str, road_type: str = "") -> LaneKind:
    """Return the kind of a lane from SUMO's space-separated vehicle classes and its type of surface."""
    if road_type == "shoulder":
        return LaneKind.SHOULDER
    return next((kind for kind, users in _USERS if _is_open(allow, disallow, users)), LaneKind.CLOSED)


def roads_for(roads: LaneGraph, net: Path, vehicle_classes: Iterable[str]) -> LaneGraph:
    """Return a map on which lanes are of kind CAR where several vehicle classes of SUMO may all use them.

    Args:
        roads: The map. For passenger cars alone it is returned as it is.
        net: The network that it was read from.
        vehicle_classes: Such as "truck".
    """
    classes = frozenset(vehicle_classes)
    return roads if classes <= {"passenger"} else _open_to_all(roads, net, classes)


def agent_roads(roads: LaneGraph, net: Path, vehicle_class: str) -> LaneGraph:
    """Return a map on which lanes are of kind CAR where an agent's vehicle of a class of SUMO may be.

    Those are lanes that cars or buses may use, as all agents are measured on them, and that are open to the
    class.

    Args:
        roads: The map. For passenger cars it is returned as it is.
        net: The network that it was read from.
        vehicle_class: Such as "truck".
    """
    return roads if vehicle_class == "passenger" else _on_roads(roads, net, vehicle_class)


@remembered(most=8)
def _on_roads(roads: LaneGraph, net: Path, vehicle_class: str) -> LaneGraph:
    is_open = roads_for(roads, net, [vehicle_class]).kind == LaneKind.CAR
    is_open &= np.isin(roads.kind, (LaneKind.CAR, LaneKind.BUS))
    return replace(roads, kind=np.where(is_open, LaneKind.CAR, LaneKind.CLOSED).astype(np.int8))


@remembered(most=8)
def _open_to_all(roads: LaneGraph, net: Path, vehicle_classes: frozenset[str]) -> LaneGraph:
    is_open = roads.kind != LaneKind.SHOULDER
    lanes = [
        (lane.get("allow", ""), lane.get("disallow", ""))
        for lane in ElementTree.parse(net).getroot().iterfind("edge/lane")
    ]
    for each in vehicle_classes:
        is_open &= [_is_open(*permissions, {each}) for permissions in lanes]
    return replace(roads, kind=np.where(is_open, LaneKind.CAR, LaneKind.CLOSED).astype(np.int8))


def _is_open(allow: str, disallow: str, users: set[str]) -> bool:
    allowed, disallowed = set(allow.split()), set(disallow.split())
    if allowed:
        return "all" in allowed or bool(users & allowed)
    return "all" not in disallowed and bool(users - disallowed)
