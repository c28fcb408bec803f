"""Episodes that this program recorded, which are folders of Parquet files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from smarts.recordings.reading import Source, tracks_of_rows
from smarts.recordings.tracks import SAMPLE, Tracks
from smarts.roads.lane_graph import LaneGraph
from smarts.types.episode_schema import EPISODE, NAMES, SIGNALS, VEHICLE, VEHICLES

_KEY = [column.name for column in VEHICLE]


def read(source: Source) -> Tracks:
    """Return all vehicles that were recorded, those of agents among them.

    Vehicles far from agents are not recorded, so tracks may begin late and have gaps.
    """
    shape, places = ["kind", "length", "width"], ["step", "x", "y", "heading", "speed"]
    wanted = {EPISODE: ["dt", "scenario", "map"], NAMES: [*_KEY, "name"], VEHICLES: [*_KEY, *shape, *places]}
    wanted[SIGNALS] = ["step", "lane", "signal"]
    episode, names, vehicles, signals = (
        pd.read_parquet(source.path / f"{table.name}.parquet", columns=columns)
        for table, columns in wanted.items()
    )
    rows = vehicles.merge(names, on=_KEY)
    dt, scenario, digest = episode.iloc[0]
    rows["t"] = rows["step"] * dt
    users = {
        name: tuple(of) for name, *of in rows.drop_duplicates("name")[["name", *shape]].to_numpy().tolist()
    }
    facts = {"name": str(scenario)}
    tracks = tracks_of_rows(rows["name"].tolist(), users, rows[[*SAMPLE]].to_numpy(float), facts)
    if not len(signals):
        return tracks
    roads = LaneGraph.load(source.path.parent / "maps" / f"{digest}.npz")
    step, lane, state = signals.to_numpy(int).T
    points = roads.point_start[[[each, roads.way_across(each)[-1] + 1] for each in lane.tolist()]]
    places = roads.point_xy[points - [0, 1]].reshape(-1, 4)
    return replace(tracks, signals=np.column_stack([step * dt, places, state]))
