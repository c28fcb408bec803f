"""Maps of Argoverse 2: `log_map_archive_ID.json`.

Source: Wilson et al., "Argoverse 2: Next Generation Datasets for Self-Driving Perception and Forecasting",
NeurIPS 2021, section on HD maps.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from smarts.roads.lane_graph import LaneKind
from smarts.roads.lanelets import Lanelet

KINDS = {"VEHICLE": LaneKind.CAR, "BUS": LaneKind.BUS, "BIKE": LaneKind.BICYCLE}


def read(path: Path) -> list[Lanelet]:
    """Return the lane segments of a map; it names no speed limits.

    Raises:
        KeyError: A segment lacks something, or is of an unknown type.
        ValueError: It is no JSON.
    """
    found = {each["id"]: each for each in json.loads(path.read_bytes())["lane_segments"].values()}
    # Of segments in opposite directions, each is the other's left neighbour.
    beside = {
        name: each["left_neighbor_id"]
        for name, each in found.items()
        if found.get(each["left_neighbor_id"], {}).get("right_neighbor_id") == name
    }
    return [
        Lanelet(
            str(name),
            *(
                np.array([[point["x"], point["y"]] for point in each[f"{side}_lane_boundary"]])
                for side in ("left", "right")
            ),
            successors=tuple(str(other) for other in each["successors"] if other in found),
            left_neighbour=str(beside.get(name, "")),
            kind=KINDS[each["lane_type"]],
            inside=each["is_intersection"],
            assumes_limit=True,
        )
        for name, each in found.items()
    ]
