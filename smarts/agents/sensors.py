"""The sensors that interfaces can switch on."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from smarts.registry import Registry, guarded


def _adopt(name: str, found: Any) -> Any:
    """Return a user's sensor: a class with the methods of `smarts.sensors.protocol.Sensor`."""
    missing = [each for each in ("fields", "bind", "as_object") if not callable(getattr(found, each, None))]
    if not isinstance(found, type) or missing:
        raise ValueError(f"is not a class with the methods fields, bind and as_object: {missing} missing")
    return _guarded_sensor(name, found)


@cache
def _guarded_sensor(name: str, found: type[Any]) -> type[Any]:
    """Return a user's sensor whose errors name its file and line."""
    doing = f"the sensor {name!r}"

    def inherited(self: Any) -> Any:
        return super(made, self)

    def fields(self: Any) -> Any:
        return guarded(inherited(self).fields, doing)()

    def bind(self: Any, *known: Any) -> Callable[..., object]:
        return guarded(guarded(inherited(self).bind, doing)(*known), doing)

    methods = {"fields": fields, "bind": bind, "as_object": staticmethod(guarded(found.as_object, doing))}
    same = {each: getattr(found, each) for each in ("__module__", "__qualname__", "__doc__")}
    made = type(found.__name__, (found,), {**same, **methods})
    return made


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
