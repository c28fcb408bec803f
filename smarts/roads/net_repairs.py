"""Repairs of a compiled SUMO network by building it again."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

from smarts.roads.converter_messages import listed
from smarts.roads.sources import MapSource
from smarts.roads.validation import bad_connections, connection_jumps, parse_net


def mended_net(net: bytes, source: MapSource) -> tuple[bytes, tuple[str, ...]]:
    """Return a network from which netconvert can build a sound one, and warnings of what is changed.

    Connections from or to lanes that do not exist are removed, since SUMO refuses them; removing them alone
    leaves junctions whose right of way counts them, at which SUMO crashes, so that the network has to be
    built again. It has to be, too, where junctions have no lanes inside. Edges and lanes keep their ids.

    Returns:
        The network, the same bytes and no warnings where it is sound.

    Raises:
        MapError: It is not a SUMO network.
    """
    root = parse_net(net, source)
    warnings = (*_without_bad_connections(root), *_without_insides(root))
    return (ElementTree.tostring(root), warnings) if warnings else (net, ())


def _without_bad_connections(root: ElementTree.Element) -> list[str]:
    bad = list(bad_connections(root))
    if not bad:
        return []
    total = len(root.findall("connection"))
    for link, _ in bad:
        root.remove(link)
    names = listed(
        f"'{link.get('from')}_{link.get('fromLane')}' to '{link.get('to')}_{link.get('toLane')}' ({problem})"
        for link, problem in bad
    )
    return [f"left out {len(bad)} of {total} connections and built the junctions again: {names}"]


def _without_insides(root: ElementTree.Element) -> list[str]:
    junctions = dict.fromkeys(connection_jumps(root))
    if not junctions:
        return []
    names = listed(f"'{name}'" for name in junctions)
    return [
        f"built the lanes inside {len(junctions)} junctions, which the network lacks, so that roads end a "
        f"little earlier there; ids of edges and lanes stay: {names}"
    ]
