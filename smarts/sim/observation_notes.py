"""What chosen agents observe with their sensors, as rows of the table `observations`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Floats
from smarts.types.episode_schema import OBSERVATIONS
from smarts.types.frame import Frame

MOST_CELLS = 64
"""Of a recorded grid, along each side; larger ones are averaged."""

Note = tuple[int, int, str, Floats]
"""Step, agent_id, name, values."""
Arrays = Mapping[str, NDArray]
"""Of one sensor and one agent, by field."""


def observation_notes(frame: Frame, row: int, agent_ids: Sequence[int], origin: Floats) -> Iterator[Note]:
    """Yield what agents of one simulation observe in a frame.

    Args:
        frame: The frame.
        row: Of the simulation.
        agent_ids: The agents; those whose readings are not of this step are left out.
        origin: What positions are relative to [m].
    """
    step = int(frame.world.step[row])
    seen = [each for each in agent_ids if frame.observe_mask[row, each]]
    for name, block in frame.readings.blocks.items() if seen else ():
        sensor = name.partition(":")[0]
        make = _SENSORS.get(sensor)
        places = frame.readings.agent_ids[name].tolist()
        for agent_id in seen:
            if make is not None and agent_id in places:
                place = places.index(agent_id)
                arrays = {field: block[field][row, place] for field in block}
                yield step, agent_id, _NAMES[sensor], make(arrays, origin)


def observations_table(notes: Sequence[Note]) -> dict[str, Sequence[Any]]:
    """Return the rows of the table."""
    rows = [(*each[:3], np.ravel(each[3]).tolist()) for each in notes]
    columns = [*zip(*rows, strict=True)] or [()] * len(OBSERVATIONS.columns)
    return dict(zip(OBSERVATIONS.names, columns, strict=True))


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
    height, width = (length // side for length in data.shape[:2])
    blocks = data[: height * side, : width * side].reshape(height, side, width, side, -1)
    cells = blocks.mean(axis=(1, 3))
    return np.concatenate([[height, width, float(arrays["resolution"]) * side], cells.ravel()])


_SENSORS: dict[str, Callable[[Arrays, Floats], Floats]] = {
    "waypoint_paths": _waypoints,
    "neighborhood_vehicle_states": _neighbors,
    "lidar_point_cloud": _lidar,
    **dict.fromkeys(("drivable_area_grid_map", "occupancy_grid_map", "occlusion_map", "top_down_rgb"), _grid),
}
_NAMES = {
    "waypoint_paths": "waypoints",
    "neighborhood_vehicle_states": "neighbors",
    "lidar_point_cloud": "lidar",
    "drivable_area_grid_map": "grid:drivable",
    "occupancy_grid_map": "grid:occupancy",
    "occlusion_map": "grid:visible",
    "top_down_rgb": "rgb:top_down",
}
