"""Episodes that this program recorded, which are folders of Parquet files."""

from __future__ import annotations

import pandas as pd
import pyarrow as pa

from smarts.recordings.reading import Source, tracks_of_rows
from smarts.recordings.tracks import RecordingError, Tracks
from smarts.types.episode_schema import EPISODE, NAMES, VEHICLE, VEHICLES, Table


def read(source: Source) -> Tracks:
    """Return all vehicles that were recorded, those of agents among them.

    Vehicles far from agents are not recorded, so tracks may begin late and have gaps.

    Raises:
        RecordingError: A file is missing, or no table of an episode.
    """
    episode, vehicles, names = (_table(source, table) for table in (EPISODE, VEHICLES, NAMES))
    key = [column.name for column in VEHICLE]
    rows = vehicles.merge(names[[*key, "name"]], on=key)
    rows["t"] = rows["step"] * float(episode["dt"].iloc[0])
    shapes = rows.drop_duplicates("name")[["name", "kind", "length", "width"]]
    users = {name: (kind, length, width) for name, kind, length, width in shapes.itertuples(index=False)}
    samples = rows[["t", "x", "y", "heading", "speed"]].to_numpy(float)
    return tracks_of_rows(rows["name"].tolist(), users, samples, {"name": str(episode["scenario"].iloc[0])})


def _table(source: Source, table: Table) -> pd.DataFrame:
    file = source.path / f"{table.name}.parquet"
    try:
        found = pd.read_parquet(file)
    except (OSError, pa.ArrowException) as error:
        raise RecordingError(f"cannot be read: {error}", place=str(file), remedy="record it again") from error
    return found
