"""CommonRoad scenarios of the format 2020a: their dynamic obstacles.

Source: https://commonroad.in.tum.de, "CommonRoad: Documentation of the XML format, version 2020a".
"""

from __future__ import annotations

from xml.etree.ElementTree import Element

import numpy as np

from smarts.recordings.reading import Source, left_out, xml_root
from smarts.recordings.tracks import RecordingError, Track, Tracks
from smarts.types.vehicles import VehicleKind

FORMAT = "2020a"
KINDS = {
    **dict.fromkeys(("car", "taxi", "priorityVehicle", "parkedVehicle"), VehicleKind.PASSENGER),
    "bus": VehicleKind.BUS,
    "truck": VehicleKind.TRUCK,
    **dict.fromkeys(("motorcycle", "bicycle"), VehicleKind.MOTORCYCLE),
}
"""Type of an obstacle -> kind; others become no tracks."""

_NOT_READ = {"staticObstacle": "static obstacle", "trafficLight": "traffic light"}


def read(source: Source) -> Tracks:
    """Return the dynamic obstacles of a scenario.

    Raises:
        RecordingError: It is no scenario of this format, or an obstacle lacks something.
    """
    root = xml_root(source.path)
    if root.tag != "commonRoad" or root.get("commonRoadVersion") != FORMAT:
        raise RecordingError(
            f"it is <{root.tag}> of {root.get('commonRoadVersion', '')!r}, not CommonRoad's format {FORMAT}",
            place=str(source.path),
            remedy="write it again with a version of commonroad-io that writes this format",
        )
    lost = [name for tag, name in _NOT_READ.items() for _ in root.iterfind(tag)]
    tracks, bicycles = [], 0
    try:
        dt = float(root.attrib["timeStepSize"])
        for obstacle in root.iterfind("dynamicObstacle"):
            kind = obstacle.findtext("type", "")
            bicycles += kind == "bicycle"
            if kind in KINDS:
                tracks.append(_track(obstacle, KINDS[kind], dt))
            else:
                lost.append(kind)
    except (ValueError, KeyError) as error:
        raise RecordingError(str(error), place=str(source.path), remedy="download it again") from error
    origin = [root.get(name, "") for name in ("author", "affiliation", "source")]
    facts = {"name": root.get("benchmarkID", ""), "attribution": "; ".join(filter(None, origin))}
    facts |= {"assumed": f"{bicycles} bicycles are motorcycles"} if bicycles else {}
    return Tracks.of(tracks, facts | left_out(lost))


def _track(obstacle: Element, kind: VehicleKind, dt: float) -> Track:
    name = obstacle.attrib["id"]
    rows = [
        (
            dt * _number(state, "time", name),
            *_position(state, name),
            _number(state, "orientation", name),
            _number(state, "velocity", name),
        )
        for state in (*obstacle.iterfind("initialState"), *obstacle.iterfind("trajectory/state"))
    ]
    across = 2 * float(obstacle.findtext("shape/circle/radius", "nan"))
    length, width = (
        float(obstacle.findtext(f"shape/rectangle/{side}", across)) for side in ("length", "width")
    )
    return Track(name, kind, length, width, np.array(rows))


def _number(state: Element, tag: str, name: str) -> float:
    """Return a number of a state, the middle of one that is given as an interval."""
    found = [state.findtext(f"{tag}/{kind}") for kind in ("exact", "intervalStart", "intervalEnd")]
    numbers = [float(text) for text in found if text is not None]
    if not numbers:
        raise ValueError(f"a state of the obstacle {name!r} has no <{tag}>")
    return sum(numbers) / len(numbers)


def _position(state: Element, name: str) -> tuple[float, float]:
    """Return a position, the centre of one that is given as an area."""
    point = state.find("position/point")
    point = state.find("position/*/center") if point is None else point
    if point is None:
        raise ValueError(f"a state of the obstacle {name!r} has no <position> with a point or a centre")
    return float(point.findtext("x", "nan")), float(point.findtext("y", "nan"))
