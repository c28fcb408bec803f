"""NGSIM's text files of 18 or 24 columns, and FILE.csv#LOCATION, in feet.

Source: US Department of Transportation, "Next Generation Simulation (NGSIM) Vehicle Trajectories".
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from smarts.recordings.headings import infer_headings
from smarts.recordings.reading import Source
from smarts.recordings.tracks import RecordingError, Track, Tracks
from smarts.types.vehicles import VehicleKind

FOOT = 0.3048
"""[m]"""
KINDS = {1: VehicleKind.MOTORCYCLE, 2: VehicleKind.PASSENGER, 3: VehicleKind.TRUCK}
NAMES = ("vehicle", "frames", "ms", "x", "y", "length", "width", "kind", "speed")
COLUMNS = dict(zip((0, 2, 3, 4, 5, 8, 9, 10, 11), NAMES, strict=True))
"""The columns that are read; x is across the road, to the right."""
HEAD = ("Vehicle_ID", "Total_Frames", "Global_Time", "Local_X", "Local_Y")
HEAD += ("v_length", "v_Width", "v_Class", "v_Vel")
"""The same in CSV."""


def read(source: Source) -> Tracks:
    """Return the vehicles, x across the road and y along it [m]; the file has them of front bumpers."""
    if ".csv" in source.path.name:
        table, key = _of_csv(source.path), ["vehicle", "frames"]  # numbers are used again after a while
    else:
        try:
            table = pd.read_csv(source.path, sep=r"\s+", header=None, usecols=list(COLUMNS), dtype=float)
        except ValueError as error:
            raise ValueError("its lines are not 18 or 24 numbers") from error
        table, key = table.rename(columns=COLUMNS), ["vehicle"]
    tracks, first = [], table["ms"].min()
    for _, rows in table.sort_values("ms").groupby(key):
        t = (rows["ms"].to_numpy() - first) / 1000
        x, y, length, width, speed = rows[["x", "y", "length", "width", "speed"]].to_numpy().T * FOOT
        heading = infer_headings(t, x, y, source.headings)
        x, y = x - length / 2 * np.cos(heading), y - length / 2 * np.sin(heading)
        kind = KINDS.get(int(rows["kind"].iloc[0]), VehicleKind.PASSENGER)
        samples = np.column_stack([t, x, y, heading, speed])
        name = "-".join(f"{rows[each].iloc[0]:.0f}" for each in key)
        tracks.append(Track(name, kind, length[0], width[0], samples))
    return Tracks.of(tracks, {"assumed": "headings follow from positions"})


def _of_csv(path: Path) -> pd.DataFrame:
    """Return the rows of a location, whose name follows the file's; of rows that are there twice, one."""
    file, _, place = path.name.partition("#")
    table = pd.read_csv(path.with_name(file), usecols=[*HEAD, "Location"])
    places = table["Location"].unique().tolist()
    if (place or len(places) > 1) and place not in places:
        raise RecordingError(
            f"it has the locations {', '.join(places)}", place=str(path), remedy=f"give {file}#{places[0]}"
        )
    table = table.loc[table["Location"] == (place or places[0])]
    table = table.drop_duplicates(subset=["Vehicle_ID", "Global_Time"])
    return table.rename(columns=dict(zip(HEAD, NAMES, strict=True))).astype(dict.fromkeys(NAMES, float))
