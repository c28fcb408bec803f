"""Episodes that this program recorded, which are folders of Parquet files."""

from __future__ import annotations

import pandas as pd

from smarts.recordings.reading import Source, tracks_of_rows
from smarts.recordings.tracks import SAMPLE, Tracks
from smarts.types.episode_schema import EPISODE, NAMES, VEHICLE, VEHICLES

_KEY = [column.name for column in VEHICLE]


def read(source: Source) -> Tracks:
    """Return all vehicles that were recorded, those of agents among them.

    Vehicles far from agents are not recorded, so tracks may begin late and have gaps.
    """
    shape, places = ["kind", "length", "width"], ["step", "x", "y", "heading", "speed"]
    wanted = {EPISODE: ["dt", "scenario"], NAMES: [*_KEY, "name"], VEHICLES: [*_KEY, *shape, *places]}
    episode, names, vehicles = (
        pd.read_parquet(source.path / f"{table.name}.parquet", columns=columns)
        for table, columns in wanted.items()
    )
    rows = vehicles.merge(names, on=_KEY)
    rows["t"] = rows["step"] * float(episode["dt"].iloc[0])
    users = {
        name: tuple(of) for name, *of in rows.drop_duplicates("name")[["name", *shape]].to_numpy().tolist()
    }
    facts = {"name": str(episode["scenario"].iloc[0])}
    return tracks_of_rows(rows["name"].tolist(), users, rows[[*SAMPLE]].to_numpy(float), facts)
