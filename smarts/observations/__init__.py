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
        name: f"smarts.observations.{place}"
        for name, place in {
            "goal": "own_state:Goal",
            "lane_offset": "own_state:LaneOffset",
            "speed": "own_state:Speed",
            "steering": "own_state:Steering",
            "heading_errors": "heading_errors:HeadingErrors",
            "neighbors": "neighbors:Neighbors",
            "neighbor_rows": "neighbor_rows:NeighborRows",
            "neighbor_sectors": "neighbor_sectors:NeighborSectors",
            "agent_index": "own_state:AgentIndex",
            "light": "light:Light",
            "time_stood": "own_state:TimeStood",
            "lane_changes": "own_state:LaneChanges",
            "arrival_order": "own_state:ArrivalOrder",
            "junction_ahead": "junction_ahead:JunctionAhead",
            "crossing_traffic": "crossing_traffic:CrossingTraffic",
            "car_following": "car_following:CarFollowing",
            "image": "image:Image",
            "action_mask": "action_mask:ActionMask",
            "sensors": "sensors:SensorReadings",
            "surroundings": "surroundings:Surroundings",
            "lane_ways": "lane_ways:LaneWays",
            "nearby": "nearby:Nearby",
            "u_turn": "u_turn:UTurnPlace",
        }.items()
    },
    _adopt,
)
"""Name -> "module:Class" of a `feature.Feature`; a user's own is such a "module:Class"."""
