"""Histories of SMARTS 2: `.shf`, an SQLite database made by its `genhistories`."""

from __future__ import annotations

import math
import sqlite3
from contextlib import closing

import numpy as np

from smarts.recordings.reading import Source, left_out, tracks_of_rows
from smarts.recordings.tracks import Tracks
from smarts.types.vehicles import VehicleKind

KINDS = {
    0: VehicleKind.PASSENGER,
    1: VehicleKind.MOTORCYCLE,
    2: VehicleKind.PASSENGER,
    3: VehicleKind.TRUCK,
}
"""Type in the database, NGSIM's or 0 for unknown -> kind. Pedestrians and bicycles, 4, are left out."""


def read(source: Source) -> Tracks:
    """Return the vehicles of a history; positions are centres, headings there begin at north."""
    with closing(sqlite3.connect(f"{source.path.resolve().as_uri()}?mode=ro", uri=True)) as database:
        vehicles = database.execute("SELECT id, type, length, width FROM Vehicle").fetchall()
        rows = database.execute(
            "SELECT vehicle_id, sim_time, position_x, position_y, heading_rad, speed FROM Trajectory"
        ).fetchall()
    users = {
        name: (KINDS[kind], float(length or math.nan), float(width or math.nan))
        for name, kind, length, width in vehicles
        if kind in KINDS
    }
    samples = np.array([row[1:] for row in rows], float).reshape(-1, 5)
    samples[:, 3] += math.pi / 2
    lost = left_out("pedestrian or bicycle" for vehicle in vehicles if vehicle[1] not in KINDS)
    return tracks_of_rows([row[0] for row in rows], users, samples, lost)
