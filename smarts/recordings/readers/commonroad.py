"""CommonRoad scenarios of the format 2020a: their dynamic obstacles and traffic lights.

Source: https://commonroad.in.tum.de, "CommonRoad: Documentation of the XML format, version 2020a".
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from smarts.recordings.reading import Source, left_out
from smarts.recordings.tracks import RecordingError, Track, Tracks
from smarts.roads.lanelet_readers.commonroad import read as read_lanelets
from smarts.roads.lanelets import Lanelet
from smarts.types.vehicles import VehicleKind

FORMAT = "2020a"
KINDS = {
    **dict.fromkeys(("car", "taxi", "priorityVehicle", "parkedVehicle"), VehicleKind.PASSENGER),
    "bus": VehicleKind.BUS,
    "truck": VehicleKind.TRUCK,
    **{kind.name.lower(): kind for kind in VehicleKind if kind >= VehicleKind.MOTORCYCLE},
}
"""Type of an obstacle -> kind; others become no tracks."""

COLOURS = ("inactive", "red", "yellow", "green")
"""In the order of `Signal`."""
_SAMPLE = ("time/exact", "position/point/x", "position/point/y", "orientation/exact", "velocity/exact")


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
    lost = ["static obstacle" for _ in root.iterfind("staticObstacle")]
    tracks, dt = [], float(root.attrib["timeStepSize"])
    for obstacle in root.iterfind("dynamicObstacle"):
        kind = obstacle.findtext("type", "")
        if kind in KINDS:
            tracks.append(_track(obstacle, KINDS[kind], dt))
        else:
            lost.append(kind)
    origin = [root.get(name, "") for name in ("author", "affiliation", "source")]
    facts = {"name": root.get("benchmarkID", ""), "attribution": "; ".join(filter(None, origin))}
    end = max((each.samples[-1, 0] for each in tracks), default=0.0)
    signals, lights = [np.zeros((0, 6))], root.findall("trafficLight")
    ways = _ways(root, read_lanelets(source.path)) if lights else {}
    for light in lights:
        own = ways.get(light.get("id", ""), [])
        signals += [(t * dt, *way, state) for t, state in _phases(light, end / dt) for way in own]
        lost += ["traffic light"] * (not own)
    return Tracks.of(tracks, facts | left_out(lost), np.vstack(signals))


def _ways(root: Element, lanes: Sequence[Lanelet]) -> dict[str, list[tuple[float, ...]]]:
    """Return the ends of the lanelets at each light, and of those behind that it is for [m]."""
    ends = {each.id: (each.left[-1] + each.right[-1]) / 2 for each in lanes}
    turns = {each.get("ref"): each.tag[10:].lower() for each in root.iterfind("intersection/incoming/*")}
    directions = {each.get("id"): each.findtext("direction", "all") for each in root.iterfind("trafficLight")}
    found: dict[str, list[tuple[float, ...]]] = {}
    for lane in lanes:
        for light, after in itertools.product(lane.lights, lane.successors):
            if directions[light] == "all" or turns.get(after, "") in directions[light].lower():
                found.setdefault(light, []).append((*ends[lane.id], *ends[after]))
    return found


def _phases(light: Element, end: float) -> Iterator[tuple[int, int]]:
    """Yield the phases of a light from a cycle before 0 on: when each begins [time steps], and its signal."""
    phases = light.findall("cycle/cycleElement") if light.findtext("active", "true") == "true" else []
    lengths = [int(each.findtext("duration", "")) for each in phases]
    if min(lengths, default=1) < 1:
        raise ValueError(f"the traffic light {light.get('id')!r} has a phase without duration")
    t = int(light.findtext("cycle/timeOffset", "0")) % sum(lengths or [1]) - sum(lengths)
    for phase, length in itertools.cycle(zip(phases, lengths, strict=True)):
        if t > end:
            return
        yield t, COLOURS.index(phase.findtext("color", "").replace("redYellow", "yellow"))
        t += length


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
