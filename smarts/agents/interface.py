"""The interface of an agent: which sensors it has, how it acts, and what ends its episode."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import field, replace
from typing import Annotated, Any, Literal, TypeVar

from pydantic import Field

from smarts.agents.checks import Count, InterfaceError, Listed, Plain, checked
from smarts.agents.criteria import DoneCriteria, EventConfiguration
from smarts.agents.options import (
    OGM,
    RGB,
    Accelerometer,
    DrivableAreaGridMap,
    LanePositions,
    Lidar,
    NeighborhoodVehicles,
    OcclusionMap,
    RoadWaypoints,
    Signals,
    Waypoints,
)
from smarts.agents.sensors import ALWAYS_ON, SENSORS
from smarts.agents.types import AgentType
from smarts.errors import nearest_names, shown
from smarts.types.actions import ActionSpaceType
from smarts.types.vehicles import VehicleKind

SENSOR_OPTIONS: Mapping[str, type] = {
    "neighborhood_vehicle_states": NeighborhoodVehicles,
    "waypoint_paths": Waypoints,
    "road_waypoints": RoadWaypoints,
    "drivable_area_grid_map": DrivableAreaGridMap,
    "occupancy_grid_map": OGM,
    "top_down_rgb": RGB,
    "lidar_point_cloud": Lidar,
    "accelerometer": Accelerometer,
    "lane_positions": LanePositions,
    "signals": Signals,
    "occlusion_map": OcclusionMap,
}
"""The fields of `AgentInterface` that switch a sensor on, and what they hold then."""

OLD_NAMES = {
    "neighborhood_vehicles": "neighborhood_vehicle_states",
    "waypoints": "waypoint_paths",
    "ogm": "occupancy_grid_map",
    "rgb": "top_down_rgb",
    "lidar": "lidar_point_cloud",
    "action_space": "action",
}
"""Names of fields when the paper was written -> in the original's last version; both are understood."""

VEHICLE_CLASSES = {
    "generic_sedan": VehicleKind.PASSENGER,
    "sedan": VehicleKind.PASSENGER,
    "passenger": VehicleKind.PASSENGER,
    "bus": VehicleKind.BUS,
    "coach": VehicleKind.COACH,
    "truck": VehicleKind.TRUCK,
    "motorcycle": VehicleKind.MOTORCYCLE,
}
"""What `AgentInterface.vehicle_class` may be."""

Wheel = Annotated[int, Plain, Field(ge=0, le=3)]
Made = TypeVar("Made")


def _understanding_old_names(cls: type[Made]) -> type[Made]:
    """Let a dataclass take, and have, the fields of `OLD_NAMES` under these names too."""
    construct = cls.__init__
    known = cls.__dataclass_fields__  # type: ignore[attr-defined]

    @functools.wraps(construct)
    def initialise(self: Made, *values: Any, **named: Any) -> None:
        fields = {OLD_NAMES.get(name, name): value for name, value in named.items()}
        # The original takes None for a sensor that is off.
        fields |= {name: False for name in SENSOR_OPTIONS if name in fields and fields[name] is None}
        further = {name: fields.pop(name) for name in [*fields] if name in SENSORS and name not in known}
        if further:
            fields["further_sensors"] = tuple((dict(fields.get("further_sensors", ())) | further).items())
        construct(self, *values, **fields)

    cls.__init__ = initialise
    for old, new in OLD_NAMES.items():
        setattr(cls, old, property(lambda self, new=new: getattr(self, new)))
    return cls


@_understanding_old_names
@checked
class AgentInterface:
    """How an agent sees and acts. Names, order and defaults of the fields are the original's.

    A sensor is switched on by True (its defaults) or by its option, such as `Waypoints(lookahead=50)`. What
    every agent gets: the state of its vehicle, its mission, and the via points near it.

    Raises:
        InterfaceError: A field is not what it can be.
    """

    debug: bool = False
    """Has no effect; the original's interfaces have it."""
    event_configuration: EventConfiguration = field(default_factory=EventConfiguration)
    done_criteria: DoneCriteria = field(default_factory=DoneCriteria)
    max_episode_steps: Count | None = None
    """Steps from entry to the time limit; None: as long as it takes."""
    neighborhood_vehicle_states: NeighborhoodVehicles | bool = False
    waypoint_paths: Waypoints | bool = False
    road_waypoints: RoadWaypoints | bool = False
    drivable_area_grid_map: DrivableAreaGridMap | bool = False
    occupancy_grid_map: OGM | bool = False
    top_down_rgb: RGB | bool = False
    lidar_point_cloud: Lidar | bool = False
    action: ActionSpaceType | None = None
    """None: the agent does not act, as with `ActionSpaceType.Empty`."""
    vehicle_type: str = ""
    """Older name of `vehicle_class`."""
    vehicle_class: str = "generic_sedan"
    """One of `VEHICLE_CLASSES`."""
    accelerometer: Accelerometer | bool = True
    lane_positions: LanePositions | bool = True
    signals: Signals | bool = False
    occlusion_map: OcclusionMap | bool = False
    """Needs an occupancy grid of the same size."""
    custom_renders: tuple[Any, ...] = ()
    """Has to be empty: there are no shaders here."""
    vehicle_model: Literal["bullet", "dynamic", "kinematic"] = "bullet"
    """How the vehicle moves: as a rigid body on tyres, or as a cheaper single-track model (not in the
    original)."""
    tyre_model: Literal["pacejka", "linear"] = "pacejka"
    """What its tyres are like (not in the original)."""
    flat_tyres: Annotated[tuple[Wheel, ...], Listed] = ()
    """Tyres that are flat from the beginning: 0 front left, 1 front right, 2 rear left, 3 rear right (not in
    the original)."""
    further_sensors: tuple[tuple[str, Any], ...] = ()
    """Other sensors of `SENSORS` by name, each True or made with options; given as keywords by their names
    (not in the original)."""

    def __post_init__(self) -> None:
        for name, kind in SENSOR_OPTIONS.items():
            if getattr(self, name) is True:
                object.__setattr__(self, name, kind())
        object.__setattr__(self, "further_sensors", _switched_on(self.further_sensors))
        if self.vehicle_type:
            object.__setattr__(self, "vehicle_class", self.vehicle_type)
        if self.vehicle_class not in VEHICLE_CLASSES:
            raise InterfaceError(
                f"there is no vehicle class {self.vehicle_class!r}",
                place="AgentInterface.vehicle_class",
                remedy=nearest_names(self.vehicle_class, VEHICLE_CLASSES),
            )
        if self.custom_renders:
            raise InterfaceError(
                "custom_renders need OpenGL, which is not used here",
                place="AgentInterface",
                remedy="draw from drivable_area_grid_map, occupancy_grid_map and top_down_rgb instead",
            )
        self._check_occlusion()

    def _check_occlusion(self) -> None:
        grid, hidden = self.occupancy_grid_map, self.occlusion_map
        if not isinstance(hidden, OcclusionMap):
            return
        if not isinstance(grid, OGM) or (grid.width, grid.height) != (hidden.width, hidden.height):
            raise InterfaceError(
                "an occlusion map needs an occupancy grid of the same size",
                place="AgentInterface.occlusion_map",
                remedy=f"occupancy_grid_map=OGM(width={hidden.width}, height={hidden.height}, ...)",
            )

    @staticmethod
    def from_type(requested_type: AgentType, **changes: Any) -> AgentInterface:
        """Return the interface of an agent type, with some fields changed.

        Raises:
            InterfaceError: There is no such type, or a change is not possible.
        """
        if requested_type not in _PRESETS:
            nearest = nearest_names(str(requested_type), AgentType.__members__)
            raise InterfaceError(
                f"there is no agent type {requested_type!r}",
                place="AgentInterface.from_type",
                remedy=f"give a member of AgentType: {nearest}",
            )
        return AgentInterface(**_PRESETS[requested_type]).replace(**changes)

    def replace(self, **changes: Any) -> AgentInterface:
        """Return a copy with some fields changed."""
        return replace(self, **{OLD_NAMES.get(name, name): value for name, value in changes.items()})

    @property
    def requires_rendering(self) -> bool:
        """Whether any picture is drawn."""
        return bool(self.drivable_area_grid_map or self.occupancy_grid_map or self.top_down_rgb)

    @property
    def vehicle_kind(self) -> VehicleKind:
        """What the agent drives."""
        return VEHICLE_CLASSES[self.vehicle_class]

    @property
    def sensors(self) -> dict[str, Any]:
        """The options of the sensors that are switched on, by field."""
        options = {name: getattr(self, name) for name in SENSOR_OPTIONS}
        return {name: option for name, option in options.items() if option is not False} | dict(
            self.further_sensors
        )

    def __getattr__(self, name: str) -> Any:
        """Return the option of a further sensor, False if it is off."""
        if name in SENSORS and "further_sensors" in self.__dict__:
            return dict(self.further_sensors).get(name, False)
        raise AttributeError(f"AgentInterface has no field {name!r}", name=name, obj=self)


def _switched_on(sensors: tuple[tuple[str, Any], ...]) -> tuple[tuple[str, Any], ...]:
    """Return the further sensors that are not off."""
    for name, option in sensors:
        if name in ALWAYS_ON or (option not in (True, False, None) and not hasattr(option, "bind")):
            raise InterfaceError(
                f"{name} is {shown(option)}",
                place=f"AgentInterface.{name}",
                remedy="leave it out: every agent has it" if name in ALWAYS_ON else "give True or the sensor",
            )
    return tuple((name, option) for name, option in sensors if option)


_WAYPOINTS: dict[str, Any] = {"waypoint_paths": True}
_TRAFFIC: dict[str, Any] = {"waypoint_paths": True, "neighborhood_vehicle_states": True}

_PRESETS: Mapping[AgentType, dict[str, Any]] = {
    AgentType.Buddha: {"action": ActionSpaceType.Empty},
    AgentType.Full: {
        **_TRAFFIC,
        "road_waypoints": True,
        "drivable_area_grid_map": True,
        "occupancy_grid_map": True,
        "top_down_rgb": True,
        "lidar_point_cloud": True,
        "accelerometer": True,
        "lane_positions": True,
        "signals": True,
        "action": ActionSpaceType.Continuous,
    },
    AgentType.Standard: {**_TRAFFIC, "action": ActionSpaceType.ActuatorDynamic},
    AgentType.Laner: {**_WAYPOINTS, "action": ActionSpaceType.Lane},
    AgentType.Loner: {**_WAYPOINTS, "action": ActionSpaceType.Continuous},
    AgentType.Tagger: {**_TRAFFIC, "action": ActionSpaceType.Continuous},
    AgentType.StandardWithAbsoluteSteering: {**_TRAFFIC, "action": ActionSpaceType.Continuous},
    AgentType.LanerWithSpeed: {**_WAYPOINTS, "action": ActionSpaceType.LaneWithContinuousSpeed},
    AgentType.Tracker: {**_WAYPOINTS, "action": ActionSpaceType.Trajectory},
    AgentType.Boid: {**_TRAFFIC, "action": ActionSpaceType.MultiTargetPose},
    AgentType.MPCTracker: {**_WAYPOINTS, "action": ActionSpaceType.MPC},
    AgentType.TrajectoryInterpolator: {"action": ActionSpaceType.TrajectoryWithTime},
    AgentType.Direct: {
        "neighborhood_vehicle_states": True,
        "signals": True,
        "action": ActionSpaceType.Direct,
    },
}
