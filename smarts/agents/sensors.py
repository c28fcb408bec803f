"""The sensors that interfaces can switch on."""

from __future__ import annotations

from typing import Any

from smarts.registry import Registry


def _adopt(name: str, found: Any) -> Any:
    """Return a user's sensor: a class with the methods of `smarts.sensors.protocol.Sensor`."""
    missing = [each for each in ("fields", "bind", "as_object") if not callable(getattr(found, each, None))]
    if not isinstance(found, type) or missing:
        raise ValueError(f"is not a class with the methods fields, bind and as_object: {missing} missing")
    return found


SENSORS = Registry(
    "sensor",
    {
        name: f"smarts.sensors.{name}:{kind}"
        for name, kind in {
            "ego_vehicle_state": "EgoVehicleState",
            "mission": "MissionAndGoal",
            "via_data": "ViaPoints",
            "neighborhood_vehicle_states": "NeighborhoodVehicleStates",
            "waypoint_paths": "WaypointPathsAhead",
            "lane_positions": "LanePosition",
            "accelerometer": "AccelerationAndJerk",
            "signals": "SignalsAhead",
            "road_waypoints": "RoadWaypointsAround",
            "drivable_area_grid_map": "DrivableArea",
            "occupancy_grid_map": "OccupancyGrid",
            "top_down_rgb": "TopDownRgb",
            "lidar_point_cloud": "LidarPoints",
            "occlusion_map": "VisibleArea",
        }.items()
    },
    _adopt,
)
"""Name of a field of `AgentInterface`, and of an attribute of `Observation` -> "module:Class" of a
`smarts.sensors.protocol.Sensor`. Names that the original does not have are also keywords of
`AgentInterface`."""

ALWAYS_ON = ("ego_vehicle_state", "mission", "via_data")
"""The sensors that every agent has."""
