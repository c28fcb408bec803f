"""INTERACTION's tables: `vehicle_tracks_000.csv`, `pedestrian_tracks_000.csv`.

Source: Zhan et al., "INTERACTION Dataset: An International, Adversarial and Cooperative Motion Dataset in
Interactive Driving Scenarios with Semantic Maps", 2019, and the page of its format.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from smarts.recordings.reading import Source, left_out, tracks_of_rows
from smarts.recordings.tracks import Tracks
from smarts.types.vehicles import VehicleKind

KINDS = {kind.name.lower(): kind for kind in VehicleKind}
KINDS |= {"car": VehicleKind.PASSENGER, "pedestrian/bicycle": VehicleKind.PEDESTRIAN}
"""Type of an agent -> kind; others become no tracks."""


def read(source: Source) -> Tracks:
    """Return the vehicles of a table, and the pedestrians and bicycles of the one that lies beside."""
    beside = source.path.with_name(source.path.name.replace("vehicle_", "pedestrian_", 1))
    table = pd.concat([pd.read_csv(file) for file in dict.fromkeys((source.path, beside)) if file.exists()])
    table = table.reindex(columns=[*table, *({"psi_rad", "length", "width"} - {*table})])
    names, speed = table["track_id"].astype(str), np.hypot(table["vx"], table["vy"])
    first = table.groupby(names, sort=False)[["agent_type", "length", "width"]].first()
    users = {
        str(name): (KINDS[kind], length, width)
        for name, kind, length, width in first.itertuples()
        if kind in KINDS
    }
    samples = np.column_stack([table["timestamp_ms"] / 1000, table[["x", "y", "psi_rad"]], speed])
    lost = left_out(kind for kind in first["agent_type"] if kind not in KINDS)
    return tracks_of_rows([*names], users, samples, lost)
