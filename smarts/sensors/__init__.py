"""Sensors: one file each, pure functions of the scene, batched over the agents of all simulations."""

from smarts.registry import Registry

SENSORS = Registry(
    "sensor",
    {
        "ego_vehicle_state": "smarts.sensors.ego_vehicle_state:EgoVehicleState",
        "neighborhood_vehicle_states": (
            "smarts.sensors.neighborhood_vehicle_states:NeighborhoodVehicleStates"
        ),
        "waypoint_paths": "smarts.sensors.waypoint_paths:WaypointPathsAhead",
        "lane_positions": "smarts.sensors.lane_positions:LanePosition",
    },
)
"""Name of the option in `AgentInterface` -> "module:Class" of a `smarts.sensors.protocol.Sensor`."""
