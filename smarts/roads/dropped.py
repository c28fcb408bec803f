"""Parts of a foreign map that the compiled network lacks, or shows otherwise."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from smarts.roads.sources import MapSource

_FOR_CARS = {"driving", "entry", "exit", "onRamp", "offRamp", "connectingRamp", "bidirectional", "bus"}
"""OpenDRIVE's types of lanes on which cars or buses drive."""


def dropped_parts(source: MapSource, net: bytes) -> tuple[str, ...]:
    """Return notes on the ways (OSM) or lanes (OpenDRIVE) that have no counterpart in the network.

    The network has to name its originals (netconvert's option `output.original-names`).
    """
    kept = {
        name
        for param in ElementTree.fromstring(net).iter("param")
        if param.get("key") == "origId"
        for name in param.get("value", "").split()
    }
    if source.kind == "osm":
        parts, noun = _osm_ways(source.files[0]), "ways with highway"
    elif source.kind == "opendrive":
        parts, noun = _opendrive_lanes(source.files[0]), "lanes of type"
    else:
        return ()
    total, lost = 0, Counter[str]()
    for name, kind in parts:
        total += 1
        lost[kind] += name not in kept
    listed = ", ".join(f"{count} {kind}" for kind, count in sorted(lost.items()) if count)
    return (f"dropped {lost.total()} of {total} {noun}: {listed}",) if listed else ()


def _osm_ways(path: Path) -> Iterator[tuple[str, str]]:
    """Yield id and kind of every way that is a road or path."""
    for _, element in ElementTree.iterparse(path):
        if element.tag == "way":
            tags = {tag.get("k"): tag.get("v", "") for tag in element.iterfind("tag")}
            if "highway" in tags:
                yield element.attrib["id"], tags["highway"]
        if element.tag in ("way", "node", "relation"):
            element.clear()


def _opendrive_lanes(path: Path) -> Iterator[tuple[str, str]]:
    """Yield name and type of every lane, as netconvert names it; lanes inside junctions are its own."""
    seen: set[str] = set()
    for road in ElementTree.parse(path).getroot().iterfind("road"):
        if road.get("junction", "-1") != "-1":
            continue
        for lane in road.iterfind("lanes/laneSection/*/lane"):
            name = f"{road.get('id')}_{lane.get('id')}"
            if lane.get("id") != "0" and name not in seen:
                seen.add(name)
                yield name, lane.get("type", "none")


def tapering_lanes(source: MapSource) -> tuple[str, ...]:
    """Return a note on the lanes for cars of an OpenDRIVE map whose width changes along them."""
    if source.kind != "opendrive":
        return ()
    sections = ElementTree.parse(source.files[0]).getroot().iterfind("road/lanes/laneSection")
    lanes = [lane for section in sections for lane in section.iterfind("*/lane")]
    widths = [_widths(lane) for lane in lanes if lane.get("id") != "0" and lane.get("type") in _FOR_CARS]
    count = sum(any(map(any, (row[1:] for row in rows))) or len(set(rows)) > 1 for rows in widths)
    if not count:
        return ()
    return (f"{count} of {len(widths)} lanes taper; on the map, each is a strip of constant width",)


def _widths(lane: ElementTree.Element) -> list[tuple[float, ...]]:
    """Return the coefficients of a lane's width, lowest power first, of each part."""
    return [tuple(float(width.get(name, 0)) for name in "abcd") for width in lane.iterfind("width")]
