"""Checks of a compiled network before a map is read from it."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping, Set

import numpy as np

from smarts.arrays import Floats
from smarts.errors import MapError
from smarts.geometry.frames import FARTHEST
from smarts.roads.lane_graph import LaneKind
from smarts.roads.permissions import lane_kind
from smarts.roads.sources import MapSource

WIDEST_GAP = 5.0
"""Largest gap between lanes that are connected without a lane inside the junction [m].

Old nets have such connections in the middle of straight roads, some to the lane beside.
"""


def validate_net(net: bytes, source: MapSource) -> None:
    """Check a compiled network, given as the bytes of its file.

    Raises:
        MapError: It is not a SUMO network, no car can drive on it, its traffic keeps to the left, or its
            junctions have no lanes inside.
    """
    place = str(source.files[0])
    root = parse_net(net, source)
    _check_lanes(root, place)
    _check_extent(root, place)


def parse_net(net: bytes, source: MapSource) -> ElementTree.Element:
    """Return the outermost element of a network whose traffic keeps to the right.

    Raises:
        MapError: It is no such network.
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
    return root


def _check_extent(root: ElementTree.Element, place: str) -> None:
    """Require roads within `FARTHEST`: files of some countries have the zone's number before each easting."""
    for lane in root.iterfind("edge/lane"):
        for point in lane.get("shape", "").split():
            if max(abs(float(number)) for number in point.split(",")[:2]) >= FARTHEST:
                raise MapError(
                    f"{point!r} in its shape is {FARTHEST:.0e} m or more from the origin",
                    place=f"{place}: lane '{lane.get('id')}'",
                    remedy="move the map: take the zone's number off its coordinates, or convert it with "
                    "netconvert's --offset.x and --offset.y",
                )


def bad_connections(root: ElementTree.Element) -> Iterator[tuple[ElementTree.Element, str]]:
    """Yield the connections from, to or through lanes that do not exist, and what is wrong with each."""
    counts = {edge.get("id", ""): len(edge.findall("lane")) for edge in root.iterfind("edge")}
    lanes = {lane.get("id", "") for lane in root.iterfind("edge/lane")}
    for link in root.iterfind("connection"):
        problem = next(_problems(link, counts, lanes), None)
        if problem is not None:
            yield link, problem


def _problems(link: ElementTree.Element, counts: Mapping[str, int], lanes: Set[str]) -> Iterator[str]:
    for end in ("from", "to"):
        name, number = link.get(end, ""), link.get(f"{end}Lane", "")
        if name not in counts:
            yield f"there is no edge '{name}'"
        elif not number.isdecimal() or int(number) >= counts[name]:
            yield f"edge '{name}' has no lane {number!r}"
    via = link.get("via")
    if via is not None and via not in lanes:
        yield f"there is no lane '{via}' inside the junction"


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
    jumps = connection_jumps(root)
    if jumps:
        raise MapError(
            f"{len(jumps)} connections jump more than {WIDEST_GAP:g} m or have a light, without lanes inside "
            "the junctions",
            place=place,
            remedy="build them: netconvert --sumo-net-file map.net.xml --no-internal-links false "
            "--junctions.internal-link-detail 20 --output-file map.net.xml",
        )


def connection_jumps(root: ElementTree.Element) -> list[str]:
    """Return the junctions of all connections that lack a lane inside.

    They lead from road to road over more than `WIDEST_GAP`, or have a light, which such a lane shows.
    """
    roads = [edge for edge in root.iter("edge") if edge.get("function", "normal") == "normal"]
    ends = {
        (edge.get("id"), lane.get("index")): (_point(lane, 0), _point(lane, -1))
        for edge in roads
        for lane in edge.iter("lane")
    }
    junctions = {edge.get("id"): edge.get("to", "") for edge in roads}

    def jumps(connection: ElementTree.Element) -> bool:
        source = ends.get((connection.get("from"), connection.get("fromLane")))
        target = ends.get((connection.get("to"), connection.get("toLane")))
        if connection.get("via") is not None or source is None or target is None:
            return False
        return connection.get("tl") is not None or bool(np.hypot(*(target[0] - source[1])) > WIDEST_GAP)

    return [junctions[each.get("from")] for each in root.iter("connection") if jumps(each)]


def _point(lane: ElementTree.Element, number: int) -> Floats:
    return np.array([float(value) for value in lane.get("shape", "").split()[number].split(",")[:2]])
