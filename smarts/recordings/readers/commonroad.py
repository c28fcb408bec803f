"""CommonRoad scenarios of the format 2020a: their dynamic obstacles.

Source: https://commonroad.in.tum.de, "CommonRoad: Documentation of the XML format, version 2020a".
"""

from __future__ import annotations

from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from smarts.recordings.reading import Source, left_out
from smarts.recordings.tracks import RecordingError, Track, Tracks
from smarts.types.vehicles import VehicleKind

FORMAT = "2020a"
KINDS = {
    **dict.fromkeys(("car", "taxi", "priorityVehicle", "parkedVehicle"), VehicleKind.PASSENGER),
    "bus": VehicleKind.BUS,
    "truck": VehicleKind.TRUCK,
    **{kind.name.lower(): kind for kind in VehicleKind if kind >= VehicleKind.MOTORCYCLE},
}
"""Type of an obstacle -> kind; others become no tracks."""

_SAMPLE = ("time/exact", "position/point/x", "position/point/y", "orientation/exact", "velocity/exact")
_NOT_READ = {"staticObstacle": "static obstacle", "trafficLight": "traffic light"}


def read(source: Source) -> Tracks:
    """Return the dynamic obstacles of a scenario.

    Raises:
        RecordingError: It is no scenario of this format.
        ValueError: An obstacle lacks something.
    """
    root = ElementTree.parse(source.path).getroot()
    if root.tag != "commonRoad" or root.get("commonRoadVersion") != FORMAT:
        raise RecordingError(
            f"it is <{root.tag}> of {root.get('commonRoadVersion', '')!r}, not CommonRoad's format {FORMAT}",
            place=str(source.path),
            remedy="write it again with a version of commonroad-io that writes this format",
        )
    lost = [name for tag, name in _NOT_READ.items() for _ in root.iterfind(tag)]
    tracks, dt = [], float(root.attrib["timeStepSize"])
    for obstacle in root.iterfind("dynamicObstacle"):
        kind = obstacle.findtext("type", "")
        if kind in KINDS:
            tracks.append(_track(obstacle, KINDS[kind], dt))
        else:
            lost.append(kind)
    origin = [root.get(name, "") for name in ("author", "affiliation", "source")]
    facts = {"name": root.get("benchmarkID", ""), "attribution": "; ".join(filter(None, origin))}
    return Tracks.of(tracks, facts | left_out(lost))


def _track(obstacle: Element, kind: VehicleKind, dt: float) -> Track:
    name = obstacle.attrib["id"]
    rows = [
        [_number(state, path, name) for path in _SAMPLE]
        for state in (*obstacle.iterfind("initialState"), *obstacle.iterfind("trajectory/state"))
    ]
    across = 2 * float(obstacle.findtext("shape/circle/radius", "nan"))
    length, width = (
        float(obstacle.findtext(f"shape/rectangle/{side}", across)) for side in ("length", "width")
    )
    samples = np.array(rows) * (dt, 1, 1, 1, 1)
    return Track(name, kind, length, width, samples)


def _number(state: Element, path: str, name: str) -> float:
    text = state.findtext(path)
    if text is None:
        raise ValueError(f"a state of the obstacle {name!r} has no <{path}>")
    return float(text)
