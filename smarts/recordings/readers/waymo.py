"""Scenarios of the Waymo Open Motion Dataset: `NAME.tfrecord-00000-of-01000#ID`, at 10 Hz.

`smarts.roads.waymo_scenarios` names the sources.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from smarts.recordings.reading import Source, left_out, tracks_of_rows
from smarts.recordings.tracks import Tracks
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
    names, rows, users, lost = [], [], {}, []
    for track in scenario["tracks"]:
        name, kind, samples = str(first(track, "id")), first(track, "type"), []
        for t, state in zip(scenario["t"], track["states"], strict=True):
            if first(state, "valid"):
                samples.append([t, *(first(state, field) for field in _SAMPLE)])
        if kind in KINDS and samples:
            names += [name] * len(samples)
            rows += samples
            users[name] = (KINDS[kind], *np.median(samples, axis=0)[-2:].tolist())
        elif kind not in KINDS:
            lost.append(f"object of type {kind}")
    table = np.array(rows).reshape(-1, 8)
    samples = np.column_stack([table[:, :4], np.hypot(*table[:, 4:6].T)])
    facts = {"name": first(scenario, "scenario_id"), **left_out(lost)}
    return replace(tracks_of_rows(names, users, samples, facts), signals=_signals(scenario))


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
