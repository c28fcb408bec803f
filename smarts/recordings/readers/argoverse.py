"""Scenarios of Argoverse 2 Motion Forecasting: `scenario_ID.parquet`, at 10 Hz.

Source: Wilson et al., "Argoverse 2: Next Generation Datasets for Self-Driving Perception and Forecasting",
NeurIPS 2021, and the data's user guide.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from smarts.recordings.reading import Source, left_out, tracks_of_rows
from smarts.recordings.tracks import Tracks
from smarts.types.vehicles import VehicleKind

STEP = 0.1
"""[s]"""
KINDS = {
    "vehicle": VehicleKind.PASSENGER,
    "bus": VehicleKind.BUS,
    "motorcyclist": VehicleKind.MOTORCYCLE,
    "cyclist": VehicleKind.BICYCLE,
    "pedestrian": VehicleKind.PEDESTRIAN,
}
"""Type of an object -> kind; others become no tracks."""


def read(source: Source) -> Tracks:
    """Return the road users of a file, or a scenario's folder; the format has no sizes.

    The vehicle that records has the number after the highest, as in SMARTS 2.
    """
    table = pd.read_parquet(next(source.path.glob("scenario_*.parquet"), source.path))
    last = max((int(name) for name in table["track_id"] if name != "AV"), default=0)
    table["track_id"] = table["track_id"].replace("AV", str(last + 1))
    kinds = dict(zip(table["track_id"], table["object_type"], strict=True))
    users = {name: (KINDS[kind], np.nan, np.nan) for name, kind in kinds.items() if kind in KINDS}
    speed = np.hypot(table["velocity_x"], table["velocity_y"])
    place = table[["position_x", "position_y", "heading"]]
    samples = np.column_stack([STEP * table["timestep"], place, speed])
    lost = left_out(kind for kind in kinds.values() if kind not in KINDS)
    return tracks_of_rows([*table["track_id"]], users, samples, lost)
