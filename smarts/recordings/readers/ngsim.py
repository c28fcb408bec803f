"""NGSIM's text files of 18 or 24 columns, in feet.

Source: US Department of Transportation, "Next Generation Simulation (NGSIM) Vehicle Trajectories".
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from smarts.recordings.headings import infer_headings
from smarts.recordings.reading import Source
from smarts.recordings.tracks import Track, Tracks
from smarts.types.vehicles import VehicleKind

FOOT = 0.3048
"""[m]"""
KINDS = {1: VehicleKind.MOTORCYCLE, 2: VehicleKind.PASSENGER, 3: VehicleKind.TRUCK}
COLUMNS = {0: "vehicle", 3: "ms", 4: "x", 5: "y", 8: "length", 9: "width", 10: "kind", 11: "speed"}
"""The columns that are read; x is across the road, to the right."""


def read(source: Source) -> Tracks:
    """Return the vehicles, x across the road and y along it [m]; the file has them of front bumpers."""
    try:
        table = pd.read_csv(source.path, sep=r"\s+", header=None, usecols=list(COLUMNS), dtype=float)
    except ValueError as error:
        raise ValueError("its lines are not 18 or 24 numbers") from error
    tracks, first = [], table[3].min()
    for vehicle, rows in table.rename(columns=COLUMNS).sort_values("ms").groupby("vehicle"):
        t = (rows["ms"].to_numpy() - first) / 1000
        x, y, length, width, speed = rows[["x", "y", "length", "width", "speed"]].to_numpy().T * FOOT
        heading = infer_headings(t, x, y, source.headings)
        x, y = x - length / 2 * np.cos(heading), y - length / 2 * np.sin(heading)
        kind = KINDS.get(int(rows["kind"].iloc[0]), VehicleKind.PASSENGER)
        samples = np.column_stack([t, x, y, heading, speed])
        tracks.append(Track(f"{vehicle:.0f}", kind, length[0], width[0], samples))
    return Tracks.of(tracks, {"assumed": "headings follow from positions"})
