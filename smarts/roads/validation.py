"""What a compiled network must have before anything is built on it."""

from __future__ import annotations

import math
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
    _check_numbers(root, place)
    _check_references(root, place)
    _check_lanes(root, place)


def _check_numbers(root: ElementTree.Element, place: str) -> None:
    """Require lanes with a shape of finite points, a positive length and width, and a speed limit."""
    remedy = "mend the lane, or compile the map again with netconvert"
    for edge in root.iter("edge"):
        for lane in edge.iter("lane"):
            where = f"{place}: lane '{lane.get('id')}'"
            for name, default in (("length", ""), ("speed", ""), ("width", "3.2")):
                text = lane.get(name, default)
                # Nobody drives on footpaths and the like, whose speed limit may be anything.
                if not 0 < _finite(text) < math.inf:
                    raise MapError(f"{name}={text!r} is not a number above 0", place=where, remedy=remedy)
            points = lane.get("shape", "").split()
            if len(points) < 2 and edge.get("function", "normal") == "normal":
                raise MapError(f"a shape of {len(points)} points", place=where, remedy=remedy)
            for point in points:
                if not all(math.isfinite(_finite(text)) for text in [*point.split(","), "x"][:2]):
                    raise MapError(f"{point!r} in its shape is not a point", place=where, remedy=remedy)


def _finite(text: str) -> float:
    """Return a finite number, NaN for all else."""
    try:
        number = float(text)
    except ValueError:
        return math.nan
    return number if math.isfinite(number) else math.nan


def _check_references(root: ElementTree.Element, place: str) -> None:
    """Require that nothing has the same name twice, and connections between lanes that exist."""
    remedy = "mend the file, or compile the map again with netconvert"
    lanes: set[str] = set()
    counts: dict[str, int] = {}
    for edge in root.iterfind("edge"):
        name = edge.get("id", "")
        if name in counts:
            raise MapError(f"two edges are named '{name}'", place=place, remedy=remedy)
        counts[name] = len(edge.findall("lane"))
        for lane in edge.iterfind("lane"):
            lane_name = lane.get("id", "")
            if lane_name in lanes:
                raise MapError(f"two lanes are named '{lane_name}'", place=place, remedy=remedy)
            lanes.add(lane_name)
    for link in root.iterfind("connection"):
        where = f"{place}: connection from '{link.get('from')}' to '{link.get('to')}'"
        for end in ("from", "to"):
            name, number = link.get(end, ""), link.get(f"{end}Lane", "")
            if name not in counts:
                raise MapError(f"there is no edge '{name}'", place=where, remedy=remedy)
            if not number.isdecimal() or int(number) >= counts[name]:
                raise MapError(f"edge '{name}' has no lane {number!r}", place=where, remedy=remedy)
        via = link.get("via")
        if via is not None and via not in lanes:
            raise MapError(f"there is no lane '{via}' inside the junction", place=where, remedy=remedy)


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
