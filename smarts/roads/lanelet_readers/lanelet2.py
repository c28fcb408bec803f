"""Maps of Lanelet2: OpenStreetMap's XML with relations of type lanelet.

Source: Poggenhans et al., "Lanelet2: A high-definition map framework for the future of automated driving",
ITSC 2018, and its documents; the projection by Karney, "Transverse Mercator with an accuracy of a few
nanometers", Journal of Geodesy 85, 2011, equations 7 to 12 and 35.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from smarts.arrays import Floats
from smarts.roads.lane_graph import LaneKind
from smarts.roads.lanelets import MOTORWAY, URBAN, Lanelet

KINDS = {
    "road": LaneKind.CAR,
    "highway": LaneKind.CAR,
    "bus_lane": LaneKind.BUS,
    "bicycle_lane": LaneKind.BICYCLE,
}
"""Subtype -> kind; others, such as crosswalks, are left out."""
MILE_PER_HOUR, KILOMETRE_PER_HOUR = 0.44704, 1 / 3.6
"""[m/s]"""
_AXIS, _FLATTENING, _SCALE = 6378137.0, 1 / 298.257223563, 0.9996
"""WGS84 and UTM."""


def read(path: Path) -> list[Lanelet]:
    """Return the lanelets that vehicles drive on.

    Positions are the nodes' tags local_x and local_y; without them those of UTM, from latitude and longitude
    0 on if the map lies there, as INTERACTION's maps do.

    Raises:
        KeyError: Something that a lanelet refers to is missing.
    """
    root = ElementTree.parse(path).getroot()
    nodes = {node.attrib["id"]: node for node in root.iterfind("node")}
    places = dict(zip(nodes, _places([*nodes.values()]), strict=True))
    ways = {way.attrib["id"]: [nd.attrib["ref"] for nd in way.iterfind("nd")] for way in root.iterfind("way")}
    found = {}
    for relation in root.iterfind("relation"):
        tags = {tag.get("k"): tag.get("v", "") for tag in relation.iterfind("tag")}
        if tags.get("type") == "lanelet" and tags.get("subtype") in KINDS:
            bounds = {member.get("role"): member.get("ref", "") for member in relation.iterfind("member")}
            sides = _aligned(ways[bounds["left"]], ways[bounds["right"]], places)
            found[relation.attrib["id"]] = (tags, *sides)
    begins: dict[tuple[str, str], list[str]] = {}
    by_right = {tuple(right): name for name, (_, _, right) in found.items()}
    for name, (_, left, right) in found.items():
        begins.setdefault((left[0], right[0]), []).append(name)
    return [
        Lanelet(
            name,
            np.array([places[node] for node in left]),
            np.array([places[node] for node in right]),
            tuple(begins.get((left[-1], right[-1]), ())),
            by_right.get(tuple(left), ""),
            _limit(tags) or (MOTORWAY if tags["subtype"] == "highway" else URBAN),
            KINDS[tags["subtype"]],
            "turn_direction" in tags,
            assumes_limit=not _limit(tags),
        )
        for name, (tags, left, right) in found.items()
    ]


def _limit(tags: Mapping[str | None, str]) -> float:
    """Return the limit [m/s], as of "50", "50km/h", "30 mph"; 0 where there is none."""
    found = re.match(r"([\d.]+) *(mph)?", tags.get("speed_limit", ""))
    return float(found[1]) * (MILE_PER_HOUR if found[2] else KILOMETRE_PER_HOUR) if found else 0.0


def _aligned(left: list[str], right: list[str], places: Mapping[str, Floats]) -> tuple[list[str], list[str]]:
    """Return the nodes of both bounds in driving direction; ways may have any."""
    ends = [np.array([places[nodes[0]], places[nodes[-1]]]) for nodes in (left, right)]
    if np.hypot(*(ends[0] - ends[1]).T).sum() > np.hypot(*(ends[0] - ends[1][::-1]).T).sum():
        right = right[::-1]
    (x, y) = np.array([places[node] for node in [*left, *right[::-1]]]).T
    # Left bound forward and right bound back go round clockwise.
    area = (x * np.roll(y, -1) - y * np.roll(x, -1)).sum()
    return (left, right) if area < 0 else (left[::-1], right[::-1])


def _places(nodes: list[ElementTree.Element]) -> Floats:
    """Return the positions of nodes [m], shape (N, 2)."""
    tags = [{tag.get("k"): tag.get("v", "") for tag in node.iterfind("tag")} for node in nodes]
    if all({"local_x", "local_y"} <= {*each} for each in tags):
        return np.array([[float(each["local_x"]), float(each["local_y"])] for each in tags])
    angles = np.array([[float(node.attrib["lat"]), float(node.attrib["lon"])] for node in nodes])
    zone = np.floor((angles[:1, 1] + 180) / 6)
    is_made_up = (np.abs(angles) < 1).all()
    return _utm(angles, zone) - (_utm(np.zeros((1, 2)), zone) if is_made_up else 0.0)


def _utm(angles: Floats, zone: Floats) -> Floats:
    """Return east and north of UTM [m] of latitudes and longitudes [degrees], shape (N, 2)."""
    n = _FLATTENING / (2 - _FLATTENING)
    series = (n / 2 - 2 * n**2 / 3 + 5 * n**3 / 16, 13 * n**2 / 48 - 3 * n**3 / 5, 61 * n**3 / 240)
    sine, apart = np.sin(np.radians(angles[:, 0])), np.radians(angles[:, 1] - (6 * zone - 177))
    eccentricity = np.sqrt(_FLATTENING * (2 - _FLATTENING))
    t = np.sinh(np.arctanh(sine) - eccentricity * np.arctanh(eccentricity * sine))
    north, east = np.arctan2(t, np.cos(apart)), np.arctanh(np.sin(apart) / np.hypot(1, t))
    radius = _SCALE * _AXIS / (1 + n) * (1 + n**2 / 4 + n**4 / 64)
    terms = [(2 * k, a) for k, a in enumerate(series, 1)]
    x = east + sum(a * np.cos(k * north) * np.sinh(k * east) for k, a in terms)
    y = north + sum(a * np.sin(k * north) * np.cosh(k * east) for k, a in terms)
    return np.column_stack([500_000 + radius * x, radius * y])
