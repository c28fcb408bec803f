"""Repairs of OpenDRIVE maps before netconvert reads them."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

from smarts.errors import MapError
from smarts.roads.converter_messages import listed
from smarts.roads.sources import MapSource


def mended_opendrive(source: MapSource) -> tuple[bytes | None, tuple[str, ...]]:
    """Return an OpenDRIVE map without what netconvert fails on although no lane needs it, and warnings.

    Arcs of no curvature, which netconvert divides by, become lines. Signals without a type, which make it
    give up, connections of roads that do not exist, and the connections of direct junctions, which it does
    not know, are left out; where lanes have no connections it guesses them.

    Returns:
        The map, None where nothing has to be mended; what was left out.

    Raises:
        MapError: The map's traffic keeps to the left, which netconvert lets drive in the wrong direction.
    """
    place = str(source.files[0])
    try:
        root = ElementTree.parse(place).getroot()
    except ElementTree.ParseError:
        return None, ()  # netconvert says what is wrong
    for road in root.iterfind("road"):
        if road.get("rule") == "LHT":
            raise MapError(
                "the map's traffic keeps to the left, which is not supported",
                place=f"{place}: road '{road.get('id')}'",
                remedy='give a map of right-hand traffic (rule="RHT")',
            )
    is_mended = _straighten(root)
    warnings = (*_without_untyped_signals(root), *_without_bad_connections(root))
    return (ElementTree.tostring(root) if is_mended or warnings else None), warnings


def _straighten(root: ElementTree.Element) -> bool:
    """Make lines of arcs without curvature; return whether there are any."""
    geometries = [
        geometry
        for geometry in root.iterfind("road/planView/geometry")
        if any(float(arc.get("curvature", "nan")) == 0 for arc in geometry.iterfind("arc"))
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
