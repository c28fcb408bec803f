"""What a compiled network must have before anything is built on it."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

import numpy as np
from numpy.typing import NDArray

from smarts.errors import MapError
from smarts.roads.lane_graph import LaneKind
from smarts.roads.permissions import lane_kind
from smarts.roads.sources import MapSource

WIDEST_GAP = 5.0
"""How far lanes may be apart that lead into each other without a lane inside the junction [m].

Old nets have such connections in the middle of straight roads, some to the lane beside.
"""


def validate_net(net: bytes, source: MapSource) -> None:
    """Check a compiled network, given as the bytes of its file.

    Raises:
        MapError: It is not a SUMO network, no car can drive on it, its traffic keeps to the left, or its
            junctions have no lanes inside.
    """
    place = str(source.files[0])
    try:
        root = ElementTree.fromstring(net)
    except ElementTree.ParseError as error:
        raise MapError(
            f"not a SUMO network: {error}", place=place, remedy="write it again with netconvert"
        ) from error
    if root.tag != "net":
        raise MapError(
            f"not a SUMO network: its outermost element is <{root.tag}>, not <net>",
            place=place,
            remedy="compile it with netconvert, or give its sources instead",
        )
    if root.get("lefthand") == "true":
        raise MapError(
            "the map's traffic keeps to the left, which is not supported",
            place=place,
            remedy="convert it without the option lefthand",
        )
    _check_lanes(root, place)


def _check_lanes(root: ElementTree.Element, place: str) -> None:
    roads = [edge for edge in root.iter("edge") if edge.get("function", "normal") == "normal"]
    kinds = [
        lane_kind(lane.get("allow", ""), lane.get("disallow", ""), lane.get("type", ""))
        for edge in roads
        for lane in edge.iter("lane")
    ]
    if LaneKind.CAR not in kinds:
        raise MapError(
            f"none of the map's {len(kinds)} lanes is open to cars",
            place=place,
            remedy='a lane needs allow="passenger" or no restriction that excludes cars',
        )
    gaps = _gaps(root, roads)
    if gaps.size and gaps.max() > WIDEST_GAP:
        raise MapError(
            f"there are no lanes inside the junctions: {(gaps > WIDEST_GAP).sum()} connections jump "
            f"up to {gaps.max():.1f} m",
            place=place,
            remedy="build them: netconvert --sumo-net-file map.net.xml --no-internal-links false "
            "--junctions.internal-link-detail 20 --output-file map.net.xml",
        )


def _gaps(root: ElementTree.Element, roads: list[ElementTree.Element]) -> NDArray[np.float64]:
    """Return how far the connections jump that lead from road lane to road lane directly [m]."""
    ends = {
        (edge.get("id"), lane.get("index")): (_point(lane, 0), _point(lane, -1))
        for edge in roads
        for lane in edge.iter("lane")
    }
    jumps = []
    for connection in root.iter("connection"):
        source = ends.get((connection.get("from"), connection.get("fromLane")))
        target = ends.get((connection.get("to"), connection.get("toLane")))
        if connection.get("via") is None and source and target:
            jumps.append(np.hypot(*(target[0] - source[1])))
    return np.array(jumps)


def _point(lane: ElementTree.Element, number: int) -> NDArray[np.float64]:
    return np.array([float(value) for value in lane.get("shape", "").split()[number].split(",")[:2]])
