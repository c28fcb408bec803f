"""Observations as arrays: lists of features, computed for the agents of all simulations at once."""

from typing import Any

from smarts.registry import Registry


def _adopt(name: str, found: Any) -> Any:
    """Return a user's feature: a class with a method `bind`, such as a subclass of `Feature`."""
    if not isinstance(found, type) or not callable(getattr(found, "bind", None)):
        raise ValueError(
            "is not a class with a method 'bind': derive it from smarts.observations.feature.Feature"
        )
    return found


FEATURES = Registry(
    "feature",
    {
        name: f"smarts.observations.{name}:{kind}"
        for name, kind in {
            "goal": "Goal",
            "lane_offset": "LaneOffset",
            "speed": "Speed",
            "steering": "Steering",
            "heading_errors": "HeadingErrors",
            "neighbors": "Neighbors",
            "neighbor_rows": "NeighborRows",
            "neighbor_sectors": "NeighborSectors",
            "agent_index": "AgentIndex",
            "light": "Light",
            "time_stood": "TimeStood",
            "lane_changes": "LaneChanges",
            "arrival_order": "ArrivalOrder",
            "junction_ahead": "JunctionAhead",
            "crossing_traffic": "CrossingTraffic",
            "image": "Image",
            "action_mask": "ActionMask",
            "sensors": "SensorReadings",
            "surroundings": "Surroundings",
            "lane_ways": "LaneWays",
            "nearby": "Nearby",
            "u_turn": "UTurnPlace",
        }.items()
    },
    _adopt,
)
"""Name -> "module:Class" of a `feature.Feature`; a user's own is such a "module:Class"."""
