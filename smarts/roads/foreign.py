"""What is looked for in a map's sources before netconvert sees them, which takes some nonsense silently."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator

from smarts.errors import MapError
from smarts.roads.sources import MapSource

ROUNDING = 0.01
"""By how much lengths and widths may be below 0 in maps that were drawn by programs [m]."""


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


def _check_opendrive(source: MapSource) -> None:
    place = str(source.files[0])
    try:
        root = ElementTree.parse(source.files[0]).getroot()
    except ElementTree.ParseError:
        return  # netconvert says what is wrong
    for road in root.iterfind("road"):
        where = f"{place}: road '{road.get('id')}'"
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
