"""Observations as objects, for agents that are written in Python."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from smarts.agents.sensors import SENSORS
from smarts.roads.lane_graph import LaneGraph
from smarts.roads.scene import Scene
from smarts.types.agent_states import AgentStatus
from smarts.types.events import Event
from smarts.types.frame import Frame

if TYPE_CHECKING:
    from smarts.sensors.accelerometer import MotionChange
    from smarts.sensors.ego_vehicle_state import EgoVehicleObservation
    from smarts.sensors.grid_map import GridMap
    from smarts.sensors.lidar_point_cloud import LidarPointCloud
    from smarts.sensors.mission import MissionObservation
    from smarts.sensors.neighborhood_vehicle_states import VehicleObservation
    from smarts.sensors.road_waypoints import RoadWaypoints
    from smarts.sensors.signals import SignalObservation
    from smarts.sensors.via_data import Vias
    from smarts.sensors.waypoint import Waypoint
    from smarts.types.coordinates import RefLinePoint


class Collision(NamedTuple):
    """A vehicle that was touched."""

    collidee_id: str
    """Its public name."""


class Events(NamedTuple):
    """What happened to the agent."""

    collisions: tuple[Collision, ...]
    off_road: bool
    off_route: bool
    on_shoulder: bool
    wrong_way: bool
    not_moving: bool
    reached_goal: bool
    reached_max_episode_steps: bool
    agents_alive_done: bool
    interest_done: bool
    missed_goal: bool = False
    """Not in the original."""


# Plain numbers: arithmetic of flags is slow.
_EVENT_BITS = tuple(int(Event[name.upper()]) for name in Events._fields if name != "collisions")


class Observation:
    """What an agent observes; names of attributes and fields are the original's.

    Headings are counter-clockwise from +x, unlike the original's, which are from north. Each sensor is an
    attribute, whose value its `as_object` makes of the readings when it is first read; None if the agent does
    not have the sensor. The readings are copies: the observation stays valid after its step.
    """

    dt: float
    """Length of a step [s]."""
    step_count: int
    """Steps since the episode began."""
    steps_completed: int
    """Steps since the agent entered."""
    elapsed_sim_time: float
    """[s]"""
    events: Events
    """In all steps since the agent's last observation."""
    under_this_agent_control: bool
    """False while the agent only watches a vehicle that it may take over."""
    distance_travelled: float
    """[m]"""
    custom_renders: tuple[()]
    readings: Mapping[str, Mapping[str, NDArray]]
    """The arrays that the sensors' attributes are made of, by sensor and field (not in the original)."""
    graph: LaneGraph
    """The map (not in the original)."""
    name: str
    """Name of the vehicle (not in the original)."""
    neighbors: Sequence[str]
    """Names of the vehicles in `neighborhood_vehicle_states` (not in the original)."""

    # The sensors of the original, for type checkers and editors; `__getattr__` knows all of `SENSORS`.
    ego_vehicle_state: EgoVehicleObservation
    """The agent's vehicle."""
    neighborhood_vehicle_states: tuple[VehicleObservation, ...] | None
    """The other vehicles, nearest first."""
    waypoint_paths: list[list[Waypoint]] | None
    """The paths ahead along the route, from the right to the left."""
    road_waypoints: RoadWaypoints | None
    """The waypoints behind and ahead in all lanes of the road."""
    via_data: Vias
    """The via points near the vehicle."""
    signals: tuple[SignalObservation, ...] | None
    """The traffic lights ahead, nearest first."""
    lidar_point_cloud: LidarPointCloud | None
    """Points, whether each ray has a hit, and the rays."""
    drivable_area_grid_map: GridMap | None
    """Where there is road."""
    occupancy_grid_map: GridMap | None
    """Where there are vehicles."""
    top_down_rgb: GridMap | None
    """The scene in colour."""
    occlusion_map: GridMap | None
    """What other vehicles do not hide."""
    mission: MissionObservation
    """The agent's mission (in the original only in `ego_vehicle_state`, as the two that follow)."""
    accelerometer: MotionChange | None
    lane_positions: RefLinePoint | None

    def __init__(self, **values: Any) -> None:
        self.__dict__.update(values)

    def __getattr__(self, name: str) -> Any:
        """Return what is made when it is first read, and keep it."""
        made = self._make(name)
        self.__dict__[name] = made
        return made

    def _make(self, name: str) -> Any:
        # Through the dict: an attribute that is missing must not be looked for here again.
        values = self.__dict__
        if name == "events" and "_event_bits" in values:
            happened = (values["_event_bits"] & bit != 0 for bit in _EVENT_BITS)
            return Events(tuple(map(Collision, values["_touched"])), *happened)
        if name not in SENSORS or "readings" not in values:
            raise AttributeError(f"an Observation has no attribute {name!r}", name=name, obj=self)
        readings = values["readings"].get(name)
        return None if readings is None else SENSORS[name].as_object(readings, self)

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), "events", *SENSORS})

    def __repr__(self) -> str:
        names = ("step_count", "elapsed_sim_time", "events", "under_this_agent_control", "distance_travelled")
        values = ", ".join(f"{name}={getattr(self, name)!r}" for name in names)
        return f"Observation(of {self.name!r}, {values}, sensors: {', '.join(self.readings)})"

    @property
    def left_out(self) -> dict[str, int]:
        """How many paths or lanes did not fit into a sensor's readings, of those where some did not."""
        counts = {name: int(self.readings[name]["left_out"]) for name in _LIMITED if name in self.readings}
        return {name: count for name, count in counts.items() if count}

    def lane_ids(self, lane: int) -> tuple[str, str]:
        """Return the ids of a lane's road and of the lane, by its number in the map; empty for -1."""
        if lane < 0:
            return "", ""
        return self.graph.edge_ids[int(self.graph.lane_edge[lane])], self.graph.lane_ids[lane]


class _Readings(Mapping[str, NDArray]):
    """One agent's entries of a block of arrays, by field; a view into a copy that all agents share."""

    def __init__(self, block: Mapping[str, NDArray], row: int, column: int) -> None:
        self._block, self._place = block, (row, column)

    def __getitem__(self, field: str) -> NDArray:
        return self._block[field][self._place]

    def __iter__(self) -> Iterator[str]:
        return iter(self._block)

    def __len__(self) -> int:
        return len(self._block)

    def __reduce__(self) -> tuple[type, tuple[dict[str, NDArray]]]:
        """Pickle the agent's entries alone."""
        return dict, ({name: np.array(array) for name, array in self.items()},)


class ObservationMaker:
    """Makes agents' observations out of a frame.

    A sensor's block of arrays is copied once a frame, for all its agents.

    Args:
        scene: What is observed.
    """

    def __init__(self, scene: Scene) -> None:
        self._graphs = scene.atlas.graphs
        self._places: dict[int, list[tuple[str, str, int]]] = {}
        """By agent: sensor, block of the readings, column in it."""
        self._frame: Frame | None = None
        self._copies: dict[str, Mapping[str, NDArray]] = {}
        """Copies of that frame's blocks."""

    def touched(self, frame: Frame, row: int, agent_id: int) -> list[str]:
        """Return the public names of the vehicles that an agent's vehicle touched in a frame's step."""
        slots = np.flatnonzero(frame.contacts.touching[row, agent_id]).tolist()
        return [frame.world.registry.name(row, slot) for slot in slots]

    def __call__(
        self,
        frame: Frame,
        row: int,
        agent_id: int,
        events: int | None = None,
        touched: Sequence[str] | None = None,
    ) -> Observation:
        """Return an agent's observation; the frame must hold its readings.

        Args:
            frame: A step's, or a reset's.
            row: The simulation.
            agent_id: The agent.
            events: What happened in all steps since the agent's last observation, as `Event` bits; by default
                what happened in this step.
            touched: Public names of the vehicles that it touched in those steps; by default in this step.
        """
        world = frame.world
        readings = self._readings(frame, row, agent_id)
        near = readings.get("neighborhood_vehicle_states")
        slots = [] if near is None else near["slot"][: int(near["count"])].tolist()
        step = int(world.step[row])
        return Observation(
            dt=world.dt,
            step_count=step,
            steps_completed=step - int(world.agents.entry_step[row, agent_id]),
            elapsed_sim_time=step * world.dt,
            _event_bits=int(frame.events.bits[row, agent_id]) if events is None else events,
            _touched=self.touched(frame, row, agent_id) if touched is None else tuple(touched),
            under_this_agent_control=int(world.agents.state[row, agent_id]) != _SHADOWING,
            distance_travelled=float(world.agents.distance_travelled[row, agent_id]),
            custom_renders=(),
            readings=readings,
            graph=self._graphs[int(world.map[row])],
            name=world.registry.name(row, int(world.agents.slot[row, agent_id])),
            neighbors=[world.registry.name(row, slot) for slot in slots],
        )

    def _readings(self, frame: Frame, row: int, agent_id: int) -> dict[str, Mapping[str, NDArray]]:
        if frame is not self._frame:
            self._frame = frame
            self._copies.clear()
        if agent_id not in self._places:
            self._places[agent_id] = [
                (name.partition(":")[0], name, agents.tolist().index(agent_id))
                for name, agents in frame.readings.agent_ids.items()
                if agent_id in agents
            ]
        readings: dict[str, Mapping[str, NDArray]] = {}
        for sensor, name, column in self._places[agent_id]:
            if name not in self._copies:
                block: Any = frame.readings.blocks[name]
                self._copies[name] = block.copy()
            readings[sensor] = _Readings(self._copies[name], row, column)
        return readings


_LIMITED = ("waypoint_paths", "road_waypoints")
"""Sensors that count what did not fit."""
# A number: to compare with a member of an enumeration takes longer.
_SHADOWING = int(AgentStatus.SHADOWING)
