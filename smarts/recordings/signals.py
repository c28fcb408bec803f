"""What traffic lights showed in a recording, and which lanes of a map they govern."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import shapely

from smarts.arrays import Floats
from smarts.roads.lane_graph import LaneGraph
from smarts.whole_files import written_whole

SIGNALS = "signals.parquet"
SIGNAL = ("t", "x", "y", "to_x", "to_y", "state")
"""Columns of signals, a row for each change of a light: time since the recording's first sample [s], stop
position on the middle of the lane, a place behind the junction on the way that it governs [m], a `Signal`.

A way shows nothing before its first row."""
NO_SIGNALS = np.zeros((0, len(SIGNAL)))
APART, SAME = 20.0, 0.1
"""Distance within which a light's stop position is from the begins of the lanes that it governs, and these
from each other [m]."""


def write_signals(signals: Floats, folder: Path) -> None:
    """Write the table of signals, shape (N, 6), into a recording's folder, if there are any."""
    if len(signals):
        with written_whole(folder / SIGNALS) as partial:
            pd.DataFrame(signals, columns=[*SIGNAL]).to_parquet(partial)


def read_signals(folder: Path) -> Floats:
    """Return the signals of a recording's folder, shape (N, 6)."""
    file = folder / SIGNALS
    return pd.read_parquet(file)[[*SIGNAL]].to_numpy(float) if file.exists() else NO_SIGNALS


def lights_of(signals: Floats, roads: LaneGraph) -> tuple[Floats, int]:
    """Return what lanes in junctions show, and how many of the ways with signals are such lanes.

    A signal governs a path through a junction, from road to road, that passes its stop position and its
    position behind the junction; of several such paths, those that begin nearest to the stop position.

    Returns:
        Rows t [s], lane, `Signal` of each change, in order of time, shape (M, 3); and the number.
    """
    lanes, lines = [], []
    for lane in np.flatnonzero(roads.is_internal).tolist() if len(signals) else ():
        for origin in roads.predecessors(lane)[~roads.is_internal[roads.predecessors(lane)]].tolist():
            parts = [roads.centreline(each) for each in (origin, *roads.way_across(lane))]
            lines.append(shapely.LineString(np.concatenate(parts)))
            lanes.append(lane)
    if not lanes:
        return np.zeros((0, 3)), 0
    signals = signals[np.argsort(signals[:, 0], kind="stable")]
    ways, of = np.unique(signals[:, 1:5], axis=0, return_inverse=True)
    shapes, half = np.array(lines, object)[:, None, None], roads.width[lanes][:, None, None] / 2
    # shapely's types take one distance only.
    leads = shapely.dwithin(shapes, shapely.points(ways.reshape(-1, 2, 2)), half)  # pyright: ignore
    apart = roads.point_xy[roads.point_start[lanes]][:, None] - ways[:, :2]
    far = np.where(leads.all(axis=2), np.hypot(*apart.transpose(2, 0, 1)), np.inf)
    governs = (far < APART) & (far <= far.min(axis=0) + SAME)
    row, entry = governs[:, of.reshape(-1)].T.nonzero()
    return np.column_stack([signals[row, 0], np.array(lanes)[entry], signals[row, 5]]), int(
        governs.any(axis=0).sum()
    )
