"""Checks and repairs of foreign maps before netconvert reads them, which accepts some nonsense silently."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator

from smarts.errors import MapError
from smarts.roads.converter_messages import listed
from smarts.roads.sources import MapSource

ROUNDING = 0.01
"""Tolerance for negative lengths and widths in maps drawn by programs [m]."""


def check_sources(source: MapSource) -> None:
    """Check that the files of a map can be read and hold no numbers that make no road.

    Raises:
        MapError: They do not.
    """
    for file in source.files:
        if "," in file.name:
            raise MapError(
                f"{file.name!r} has a comma, where SUMO takes the name for two",
                place=str(file),
                remedy="rename the file",
            )
        try:
            with open(file, "rb"):
                pass
        except OSError as error:
            raise MapError(
                f"cannot read the map: {error.strerror}", place=str(file), remedy="give yourself access to it"
            ) from error
    if source.kind == "opendrive":
        _check_opendrive(source)


def mended_opendrive(source: MapSource) -> tuple[bytes | None, tuple[str, ...]]:
    """Return an OpenDRIVE map without what netconvert fails on although no lane needs it, and warnings.

    Arcs of no curvature, which netconvert divides by, become lines. Signals without a type, which make it
    give up, connections of roads that do not exist, and the connections of direct junctions, which it does
    not know, are left out; where lanes have no connections it guesses them.

    Returns:
        The map, None where nothing has to be mended; what was left out.
    """
    try:
        root = ElementTree.parse(source.files[0]).getroot()
    except ElementTree.ParseError:
        return None, ()  # netconvert says what is wrong
    is_mended = _straighten(root)
    warnings = (*_without_untyped_signals(root), *_without_bad_connections(root))
    return (ElementTree.tostring(root) if is_mended or warnings else None), warnings


def _straighten(root: ElementTree.Element) -> bool:
    """Make lines of arcs without curvature; return whether there are any."""
    geometries = [
        geometry
        for geometry in root.iterfind("road/planView/geometry")
        if any(_number(arc.get("curvature", "")) == 0 for arc in geometry.iterfind("arc"))
    ]
    for geometry in geometries:
        geometry[:] = [ElementTree.Element("line")]
    return bool(geometries)


def _without_untyped_signals(root: ElementTree.Element) -> list[str]:
    names = []
    for signals in root.iterfind("road/signals"):
        for signal in signals.findall("signal"):
            if not signal.get("type"):
                signals.remove(signal)
                names.append(f"'{signal.get('id')}'")
    return [f"left out {len(names)} signals without a type: {listed(names)}"] if names else []


def _without_bad_connections(root: ElementTree.Element) -> list[str]:
    roads = {road.get("id") for road in root.iterfind("road")}
    bad: list[str] = []
    direct: list[str] = []
    links = 0
    for junction in root.iterfind("junction"):
        is_direct = junction.get("type") == "direct"
        names, end_name = (direct, "linkedRoad") if is_direct else (bad, "connectingRoad")
        for connection in junction.findall("connection"):
            begin, end = connection.get("incomingRoad"), connection.get(end_name)
            if is_direct or not {begin, end} <= roads:
                junction.remove(connection)
                names.append(f"junction '{junction.get('id')}', road '{begin}' to '{end}'")
                links += 0 if is_direct else len(connection.findall("laneLink"))
    warnings = (
        f"left out {len(bad)} connections with {links} lane links, whose roads do not exist: {listed(bad)}",
        f"left out {len(direct)} connections of direct junctions, where netconvert guesses the lanes' links: "
        f"{listed(direct)}",
    )
    return [text for text, names in zip(warnings, (bad, direct), strict=True) if names]


def _check_opendrive(source: MapSource) -> None:
    place = str(source.files[0])
    try:
        root = ElementTree.parse(source.files[0]).getroot()
    except ElementTree.ParseError:
        return  # netconvert says what is wrong
    for road in root.iterfind("road"):
        where = f"{place}: road '{road.get('id')}'"
        if road.get("rule") == "LHT":  # netconvert would let its traffic drive in the wrong direction
            raise MapError(
                "the map's traffic keeps to the left, which is not supported",
                place=where,
                remedy='give a map of right-hand traffic (rule="RHT")',
            )
        for element, name, value, least in _numbers(road):
            if math.isnan(value) or not least <= value < math.inf:
                bound = "a number" if least == -math.inf else "a number from 0"
                raise MapError(
                    f"{name}={element.get(name)!r} of a <{element.tag}> is not {bound}",
                    place=where,
                    remedy="mend the file",
                )


def _numbers(road: ElementTree.Element) -> Iterator[tuple[ElementTree.Element, str, float, float]]:
    """Yield the numbers that make the road: element, name, value, least value allowed."""
    for element in (road, *road.iterfind("planView/geometry")):
        for name in ("length", "x", "y", "hdg", "s"):
            if name in element.attrib:
                yield (
                    element,
                    name,
                    _number(element.attrib[name]),
                    -ROUNDING if name == "length" else -math.inf,
                )
    for width in road.iterfind("lanes/laneSection/*/lane/width"):
        for name in "abcd":
            if name in width.attrib:
                yield width, name, _number(width.attrib[name]), -ROUNDING if name == "a" else -math.inf


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan
