"""What a compiled network must have before anything is built on it."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

from smarts.errors import MapError
from smarts.roads.lane_graph import LaneKind
from smarts.roads.permissions import lane_kind
from smarts.roads.sources import MapSource


def validate_net(net: bytes, source: MapSource) -> tuple[str, ...]:
    """Return notes on a compiled network, given as the bytes of its file.

    Raises:
        MapError: It is not a SUMO network, no car can drive on it, or its junctions have no lanes inside.
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
    return _check_edges(root, place)


def _check_edges(root: ElementTree.Element, place: str) -> tuple[str, ...]:
    functions = {edge.get("id", ""): edge.get("function", "normal") for edge in root.iter("edge")}
    lanes = [
        lane_kind(lane.get("allow", ""), lane.get("disallow", ""), lane.get("type", ""))
        for edge in root.iter("edge")
        if functions[edge.get("id", "")] == "normal"
        for lane in edge.iter("lane")
    ]
    if LaneKind.CAR not in lanes:
        raise MapError(
            f"none of the map's {len(lanes)} lanes is open to cars",
            place=place,
            remedy='a lane needs allow="passenger" or no restriction that excludes cars',
        )
    # A closed lane aside, every connection between two edges runs over a lane inside the junction.
    jumps = [
        c
        for c in root.iter("connection")
        if c.get("via") is None
        and not c.get("from", "").startswith(":")
        and not c.get("to", "").startswith(":")
    ]
    if jumps:
        raise MapError(
            f"the junctions have no lanes inside ({len(jumps)} connections jump across)",
            place=place,
            remedy="build them: netconvert --sumo-net-file map.net.xml --no-internal-links false "
            "--junctions.internal-link-detail 20 --output-file map.net.xml",
        )
    return ()
