"""The users of lanes, from SUMO's `allow` and `disallow` lists."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
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


@remembered(most=8)
def roads_for(roads: LaneGraph, net: Path, vehicle_class: str) -> LaneGraph:
    """Return a map on which a vehicle class of SUMO may use the lanes of kind CAR, and the others are CLOSED.

    Args:
        roads: The map.
        net: The network that it was read from.
        vehicle_class: Such as "truck".
    """
    lanes = ElementTree.parse(net).getroot().iterfind("edge/lane")
    is_open = [_is_open(lane.get("allow", ""), lane.get("disallow", ""), {vehicle_class}) for lane in lanes]
    return replace(roads, kind=np.where(is_open, LaneKind.CAR, LaneKind.CLOSED).astype(np.int8))


def _is_open(allow: str, disallow: str, users: set[str]) -> bool:
    allowed, disallowed = set(allow.split()), set(disallow.split())
    if allowed:
        return "all" in allowed or bool(users & allowed)
    return "all" not in disallowed and bool(users - disallowed)
