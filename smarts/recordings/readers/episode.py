"""Episodes that this program recorded, which are folders of Parquet files."""

from __future__ import annotations

import pandas as pd
import pyarrow as pa

from smarts.recordings.reading import Source, tracks_of_rows
from smarts.recordings.tracks import SAMPLE, RecordingError, Tracks
from smarts.types.episode_schema import EPISODE, NAMES, VEHICLE, VEHICLES, Table

_KEY = [column.name for column in VEHICLE]


def read(source: Source) -> Tracks:
    """Return all vehicles that were recorded, those of agents among them.

    Vehicles far from agents are not recorded, so tracks may begin late and have gaps.

    Raises:
        RecordingError: A file is missing, or is no such table of an episode.
    """
    episode = _table(source, EPISODE, ["dt", "scenario"])
    shape, places = ["kind", "length", "width"], ["step", "x", "y", "heading", "speed"]
    vehicles = _table(source, VEHICLES, [*_KEY, *shape, *places])
    rows = vehicles.merge(_table(source, NAMES, [*_KEY, "name"]), on=_KEY)
    rows["t"] = rows["step"] * float(episode["dt"].iloc[0])
    users = {
        name: tuple(of) for name, *of in rows.drop_duplicates("name")[["name", *shape]].to_numpy().tolist()
    }
    facts = {"name": str(episode["scenario"].iloc[0])}
    return tracks_of_rows(rows["name"].tolist(), users, rows[[*SAMPLE]].to_numpy(float), facts)


def _table(source: Source, table: Table, columns: list[str]) -> pd.DataFrame:
    file = source.path / f"{table.name}.parquet"
    try:
        return pd.read_parquet(file, columns=columns)
    except (OSError, pa.ArrowException) as error:
        raise RecordingError(
            f"it cannot be read: {error}", place=str(file), remedy="record it again"
        ) from error
