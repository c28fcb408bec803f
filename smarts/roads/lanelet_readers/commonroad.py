"""Maps of CommonRoad: the lanelets of a scenario of the format 2020a.

Source: https://commonroad.in.tum.de, "CommonRoad: Documentation of the XML format, version 2020a".
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from smarts.arrays import Floats
from smarts.roads.lane_graph import LaneKind
from smarts.roads.lanelets import MOTORWAY, URBAN, Lanelet

LIMITS = ("274", "274.1", "R2-1")
"""Signs of a speed limit, in Germany and the USA; the format gives their values in m/s."""
KINDS = {
    "busLane": LaneKind.BUS,
    "bicycleLane": LaneKind.BICYCLE,
    **dict.fromkeys(("sidewalk", "crosswalk"), LaneKind.FOOT),
}


def read(path: Path) -> list[Lanelet]:
    """Return the lanelets of a scenario.

    Raises:
        KeyError: A sign that a lanelet refers to is missing.
        ValueError: A lanelet lacks a bound, or something is no number.
    """
    root = ElementTree.parse(path).getroot()
    found = {each.get("id", ""): each for each in root.iterfind("lanelet")}
    inside = {
        way.get("ref") for way in root.iterfind("intersection/incoming/*") if way.tag.startswith("successors")
    }
    signs = {sign.get("id"): sign for sign in root.iterfind("trafficSign")}
    lanelets = []
    for name, element in found.items():
        left, right = (_bound(element, side) for side in ("leftBound", "rightBound"))
        types = {each.text for each in element.iterfind("laneletType")}
        limits = [
            float(each.findtext("additionalValue", "nan"))
            for ref in element.iterfind("trafficSignRef")
            for each in signs[ref.get("ref")].iterfind("trafficSignElement")
            if each.findtext("trafficSignID") in LIMITS
        ]
        beside = [each.attrib["ref"] for each in element.iterfind("adjacentLeft[@drivingDir='same']")]
        beyond = [each.attrib["ref"] for each in element.iterfind("successor")]
        lanelets.append(
            Lanelet(
                name,
                left,
                right,
                tuple(each for each in beyond if each in found),
                next((each for each in beside if each in found), ""),
                min(limits, default=MOTORWAY if "highway" in types else URBAN),
                next((KINDS[each] for each in KINDS if each in types), LaneKind.CAR),
                name in inside,
                tuple(each.attrib["ref"] for each in element.iterfind("trafficLightRef")),
                not limits,
            )
        )
    return lanelets


def _bound(lanelet: ElementTree.Element, side: str) -> Floats:
    points = [
        [float(point.findtext(axis, "nan")) for axis in "xy"] for point in lanelet.iterfind(f"{side}/point")
    ]
    if len(points) < 2 or not np.isfinite(points).all():
        raise ValueError(f"the {side} of the lanelet {lanelet.get('id')!r} has no two points")
    return np.array(points)
