"""Sensors: one file each, pure functions of the scene, batched over the agents of all simulations."""

from smarts.registry import Registry

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
        }.items()
    },
)
"""Name of the option in `AgentInterface` -> "module:Class" of a `smarts.sensors.protocol.Sensor`."""
