"""Parts of a foreign map that the compiled network lacks."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from smarts.roads.sources import MapSource


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
