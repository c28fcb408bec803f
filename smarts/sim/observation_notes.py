"""What chosen agents observe with their sensors, as rows of the table `observations`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Floats
from smarts.sim.episode_tables import columns_of
from smarts.types.episode_schema import OBSERVATIONS
from smarts.types.frame import Frame

MOST_CELLS = 64
"""Most cells of a recorded grid along each side; larger grids are averaged."""
MOST_KEPT = 4 << 20
"""Bytes of an episode's observations that wait in memory to be written."""

Note = tuple[int, int, str, NDArray]
"""Step, agent_id, name, values."""
Arrays = Mapping[str, NDArray]
"""Readings of one sensor and one agent, by field."""


def observation_notes(frame: Frame, row: int, seen: Mapping[int, int], origin: Floats) -> Iterator[Note]:
    """Yield what agents of one simulation have observed last.

    Args:
        frame: The frame.
        row: Row of the simulation.
        seen: The step in which each agent has observed, by agent_id.
        origin: What positions are relative to [m].
    """
    for name, block in frame.readings.blocks.items() if seen else ():
        kind, make = _SENSORS.get(name.partition(":")[0], ("", None))
        places = frame.readings.agent_ids[name].tolist()
        for agent_id, step in seen.items():
            if make is not None and agent_id in places:
                place = places.index(agent_id)
                arrays = {field: block[field][row, place] for field in block}
                yield step, agent_id, kind, make(arrays, origin)


class ObservationRows:
    """Rows of the table `observations` that are still to be written."""

    def __init__(self) -> None:
        self._notes: list[Note] = []
        self._size = 0

    def add(self, notes: Iterable[Note]) -> None:
        """Take further rows; their arrays become float32, as they are written."""
        for step, agent_id, name, values in notes:
            numbers = np.ravel(values).astype(np.float32)
            self._notes.append((step, agent_id, name, numbers))
            self._size += numbers.nbytes

    @property
    def are_many(self) -> bool:
        """Whether they are better written than kept."""
        return self._size > MOST_KEPT

    def taken(self) -> dict[str, list[Any]]:
        """Return the rows as columns, and forget them."""
        columns = columns_of(OBSERVATIONS.names, self._notes)
        self._notes, self._size = [], 0
        return columns


def _waypoints(arrays: Arrays, origin: Floats) -> Floats:
    """Return x, y in turn, with NaN, NaN between paths."""
    parts = []
    for path in range(int(arrays["path_count"])):
        points = arrays["position"][path, : int(arrays["waypoint_count"][path])] - origin
        parts += [points, np.full((1, 2), np.nan)]
    return np.concatenate(parts[:-1]).ravel() if parts else np.zeros(0)


def _neighbors(arrays: Arrays, origin: Floats) -> Floats:
    """Return x, y, heading, length, width and speed of each vehicle."""
    count = int(arrays["count"])
    columns = [
        arrays["position"][:count, :2] - origin,
        arrays["heading"][:count, None],
        arrays["bounding_box"][:count, :2],
        arrays["speed"][:count, None],
    ]
    return np.concatenate(columns, axis=1).ravel()


def _lidar(arrays: Arrays, origin: Floats) -> Floats:
    """Return x, y in turn of the points that were hit."""
    return (arrays["point"][arrays["hit"] > 0, :2] - origin).ravel()


def _grid(arrays: Arrays, origin: Floats) -> Floats:
    """Return height, width, side of a cell [m], then the cells, or red, green and blue of each, 0 to 1."""
    data = arrays["data"].astype(np.float64) / (255.0 if arrays["data"].shape[2] == 3 else 1.0)
    side = -(-max(data.shape[:2]) // MOST_CELLS)
    along, across = (_averages(length, side) for length in data.shape[:2])
    cells = np.tensordot(np.tensordot(along, data, 1), across, (1, 1)).swapaxes(1, 2)
    return np.concatenate([[*cells.shape[:2], float(arrays["resolution"]) * side], cells.ravel()])


def _averages(length: int, side: int) -> Floats:
    """Return the weights that make cells of `side` cells each out of a row, shape (cells, length).

    The row is in the middle of the larger cells, as the vehicle is; the cells at the ends average fewer.
    """
    count = -(-length // side)
    begin = (length - count * side) / 2 + side * np.arange(count)[:, None]
    at = np.arange(length)
    part = np.minimum(begin + side, at + 1) - np.maximum(begin, at)
    part = np.maximum(part, 0.0)
    return part / part.sum(axis=1, keepdims=True)


_SENSORS: dict[str, tuple[str, Callable[[Arrays, Floats], Floats]]] = {
    "waypoint_paths": ("waypoints", _waypoints),
    "neighborhood_vehicle_states": ("neighbors", _neighbors),
    "lidar_point_cloud": ("lidar", _lidar),
    "drivable_area_grid_map": ("grid:drivable", _grid),
    "occupancy_grid_map": ("grid:occupancy", _grid),
    "occlusion_map": ("grid:visible", _grid),
    "top_down_rgb": ("rgb:top_down", _grid),
}
"""Sensor -> name of its rows, and what makes them."""
