"""SUMO's floating car data: `sumo --fcd-output FILE.xml`."""

from __future__ import annotations

import math
from xml.etree.ElementTree import iterparse

import numpy as np

from smarts.geometry.frames import heading_from_compass
from smarts.recordings.reading import SIZES, Source, tracks_of_rows
from smarts.recordings.tracks import Tracks
from smarts.types.vehicles import VehicleKind

KINDS = {kind.name.lower(): kind for kind in VehicleKind}
"""Word in the name of a vehicle's type -> kind; other types are cars."""
_SAMPLE = ("x", "y", "angle", "speed")


def read(source: Source) -> Tracks:
    """Return vehicles and persons; the file has no sizes, and the middle of the front."""
    types: dict[str, str] = {}
    names, rows = [], []
    for _, step in iterparse(source.path):
        if step.tag == "timestep":
            for user in (*step.iterfind("vehicle"), *step.iterfind("person")):
                kind = "pedestrian" if user.tag == "person" else user.get("type", "").lower()
                types.setdefault(user.attrib["id"], kind)
                names.append(user.attrib["id"])
                rows.append([step.attrib["time"], *(user.attrib[name] for name in _SAMPLE)])
            step.clear()
    samples = np.array(rows, float).reshape(-1, 5)
    kinds = {
        name: next((KINDS[word] for word in KINDS if word in of), VehicleKind.PASSENGER)
        for name, of in types.items()
    }
    half = np.array([SIZES[kinds[name]][0] / 2 for name in names])
    samples[:, 3] = heading_from_compass(samples[:, 3])
    samples[:, 1] -= half * np.cos(samples[:, 3])
    samples[:, 2] -= half * np.sin(samples[:, 3])
    users = {name: (kind, math.nan, math.nan) for name, kind in kinds.items()}
    facts = {"assumed": "kinds follow from the names of types"}
    return tracks_of_rows(names, users, samples, facts)
