"""Scenarios of the Waymo Open Motion Dataset: `NAME.tfrecord-00000-of-01000#ID`, at 10 Hz.

`smarts.roads.waymo_scenarios` names the sources.
"""

from __future__ import annotations

import numpy as np

from smarts.recordings.reading import Source, left_out
from smarts.recordings.tracks import Track, Tracks
from smarts.roads.waymo_scenarios import Message, first, read_scenario
from smarts.types.traffic import Signal
from smarts.types.vehicles import VehicleKind

KINDS = {1: VehicleKind.PASSENGER, 2: VehicleKind.PEDESTRIAN, 3: VehicleKind.BICYCLE}
"""Type of an object -> kind; others become no tracks."""
SHOWN = dict(enumerate((Signal.NONE, *[*Signal][1:] * 2, Signal.CAUTION, Signal.CAUTION)))
"""By state: unknown, arrows, round lights, and flashing ones."""
_SAMPLE = ("x", "y", "heading", "vx", "vy", "length", "width")


def read(source: Source) -> Tracks:
    """Return the road users of a scenario, and what traffic lights showed.

    Lights that are not seen for a while show what they showed last.
    """
    scenario = read_scenario(source.path)
    tracks, lost = [], []
    for track in scenario["tracks"]:
        kind, states = first(track, "type"), zip(scenario["t"], track["states"], strict=True)
        rows = [[t, *(first(each, field) for field in _SAMPLE)] for t, each in states if first(each, "valid")]
        if kind not in KINDS:
            lost.append(f"object of type {kind}")
        elif rows:
            table = np.array(rows)
            samples = np.column_stack([table[:, :4], np.hypot(*table[:, 4:6].T)])
            length, width = np.median(table[:, 6:], axis=0).tolist()
            tracks.append(Track(str(first(track, "id")), KINDS[kind], length, width, samples))
    facts = {"name": first(scenario, "scenario_id"), **left_out(lost)}
    return Tracks.of(tracks, facts, _signals(scenario))


def _signals(scenario: Message) -> np.ndarray:
    """Return the changes of the lights; a light is at the begin of the lane that it governs."""
    lanes = {first(each, "id"): each["lane"][0]["polyline"] for each in scenario["features"] if each["lane"]}
    rows, last = [], {}
    for t, step in zip(scenario["t"], scenario["lights"], strict=True):
        for light in step["lanes"]:
            lane, state = first(light, "lane"), SHOWN[first(light, "state")]
            if state != last.get(lane) and (points := lanes.get(lane)):
                ends = [first(point, axis) for point in (points[0], points[-1]) for axis in "xy"]
                rows.append([t, *ends, state])
            last[lane] = state
    return np.array(rows, float).reshape(-1, 6)
