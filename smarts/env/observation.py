"""Observations as objects, for agents that are written in Python."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from smarts.env import observation_types as t
from smarts.roads.lane_graph import LaneGraph
from smarts.roads.scene import Scene
from smarts.sensors.lidar_point_cloud import ABOVE_ROOF
from smarts.types.agent_states import AgentStatus
from smarts.types.coordinates import Dimensions, Heading, Point, RefLinePoint
from smarts.types.events import Event
from smarts.types.frame import Frame
from smarts.types.mission import GoalKind
from smarts.types.traffic import Signal

Block = Mapping[str, NDArray]
"""One agent's readings of one sensor, by field."""

_LIGHTS = {
    Signal.NONE: t.SignalLightState.UNKNOWN,
    Signal.STOP: t.SignalLightState.STOP,
    Signal.CAUTION: t.SignalLightState.CAUTION,
    Signal.GO: t.SignalLightState.GO,
}


class Parts(Protocol):
    """What of `smarts.sim.assembly.Assembly` is needed here."""

    @property
    def scene(self) -> Scene: ...  # noqa: D102


class ObservationMaker:
    """Makes an agent's observation out of a frame.

    The agent's readings are copied, so that the observation stays valid after the frame; objects are made of
    them only when somebody looks.

    Args:
        parts: What the simulation was assembled into.
    """

    def __init__(self, parts: Parts) -> None:
        self._graphs = parts.scene.atlas.graphs
        self._places: dict[int, list[tuple[str, str, int]]] = {}
        """By agent: sensor, block of the readings, column in it."""

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
        """Return what the agent of an agent sees; the frame must hold its readings.

        Args:
            frame: A step's, or a reset's.
            row: The simulation.
            agent_id: The agent's.
            events: What happened in all steps since the agent's last observation, as `Event` bits; by default
                what happened in this step.
            touched: Whom it touched in those steps, by public name; by default in this step.
        """
        if agent_id not in self._places:
            self._places[agent_id] = [
                (name.partition(":")[0], name, agents.tolist().index(agent_id))
                for name, agents in frame.readings.agent_ids.items()
                if agent_id in agents
            ]
        readings = {
            sensor: {field: array[row, column].copy() for field, array in frame.readings.blocks[name].items()}
            for sensor, name, column in self._places[agent_id]
        }
        world = frame.world
        bits = int(frame.events.bits[row, agent_id]) if events is None else events
        touched = self.touched(frame, row, agent_id) if touched is None else touched
        near = readings.get("neighborhood_vehicle_states")
        slots = [] if near is None else near["slot"][: int(near["count"])].tolist()
        step = int(world.step[row])
        return Observation(
            dt=world.dt,
            step_count=step,
            steps_completed=step - int(world.agents.entry_step[row, agent_id]),
            elapsed_sim_time=step * world.dt,
            events=_events(bits, touched),
            under_this_agent_control=bool(world.agents.state[row, agent_id] != AgentStatus.SHADOWING),
            distance_travelled=float(world.agents.distance_travelled[row, agent_id]),
            readings=readings,
            graph=self._graphs[int(world.map[row])],
            name=world.registry.name(row, int(world.agents.slot[row, agent_id])),
            neighbours=[world.registry.name(row, slot) for slot in slots],
        )


def _events(bits: int, touched: Sequence[str]) -> t.Events:
    return t.Events(
        collisions=tuple(t.Collision(name) for name in touched),
        **{name: bool(bits & Event[name.upper()]) for name in t.Events._fields if name != "collisions"},
    )


@dataclass(frozen=True, eq=False)
class Observation:
    """What an agent sees; names are the original's. Sensors that are off give None."""

    dt: float
    """Length of a step [s]."""
    step_count: int
    """Steps since the episode began."""
    steps_completed: int
    """Steps since the agent entered."""
    elapsed_sim_time: float
    """[s]"""
    events: t.Events
    under_this_agent_control: bool
    """False while the agent only watches a vehicle that it may take over."""
    distance_travelled: float
    """[m]"""
    readings: Mapping[str, Block] = field(repr=False)
    """The arrays that everything else is made of, by sensor (not in the original)."""
    graph: LaneGraph = field(repr=False)
    """The map (not in the original)."""
    name: str
    """Of the vehicle."""
    neighbours: Sequence[str]
    """Names of the vehicles in the readings."""
    custom_renders: tuple[()] = ()

    @cached_property
    def ego_vehicle_state(self) -> t.EgoVehicleObservation:
        """The agent's vehicle."""
        ego, motion = self.readings["ego_vehicle_state"], self.readings.get("accelerometer")
        yaw_rate = float(ego["yaw_rate"])
        road_id, lane_id = self._ids(int(ego["lane"]))
        return t.EgoVehicleObservation(
            id=self.name,
            position=_triple(ego["position"]),
            bounding_box=Dimensions(*_triple(ego["bounding_box"])),
            heading=Heading(float(ego["heading"])),
            speed=float(ego["speed"]),
            steering=float(ego["steering"]),
            yaw_rate=yaw_rate,
            road_id=road_id,
            lane_id=lane_id,
            lane_index=int(ego["lane_index"]),
            mission=self._mission,
            linear_velocity=_triple(ego["linear_velocity"]),
            angular_velocity=(0.0, 0.0, yaw_rate),
            linear_acceleration=_triple(motion["linear_acceleration"]) if motion else None,
            angular_acceleration=(0.0, 0.0, float(motion["angular_acceleration"])) if motion else None,
            linear_jerk=_triple(motion["linear_jerk"]) if motion else None,
            angular_jerk=(0.0, 0.0, float(motion["angular_jerk"])) if motion else None,
            lane_position=self._lane_position,
        )

    @cached_property
    def neighborhood_vehicle_states(self) -> tuple[t.VehicleObservation, ...] | None:
        """The other vehicles, nearest first."""
        near = self.readings.get("neighborhood_vehicle_states")
        if near is None:
            return None
        return tuple(self._neighbour(near, number, name) for number, name in enumerate(self.neighbours))

    @cached_property
    def waypoint_paths(self) -> list[list[t.Waypoint]] | None:
        """The paths ahead along the route, from the right to the left."""
        paths = self.readings.get("waypoint_paths")
        if paths is None:
            return None
        return [
            self._waypoints(paths, path, int(paths["waypoint_count"][path]))
            for path in range(int(paths["path_count"]))
        ]

    @cached_property
    def road_waypoints(self) -> t.RoadWaypoints | None:
        """The waypoints behind and ahead in all lanes of the road."""
        road = self.readings.get("road_waypoints")
        if road is None:
            return None
        lanes: dict[str, list[list[t.Waypoint]]] = {}
        for number in range(int(road["lane_count"])):
            points = self._waypoints(road, number, int(road["waypoint_count"][number]))
            lanes.setdefault(points[int(road["beside"][number])].lane_id, []).append(points)
        return t.RoadWaypoints(lanes)

    @cached_property
    def via_data(self) -> t.Vias:
        """The via points near the vehicle."""
        vias = self.readings["via_data"]
        return t.Vias(
            tuple(
                t.ViaPoint(
                    position=(float(vias["position"][number, 0]), float(vias["position"][number, 1])),
                    lane_index=int(vias["lane_index"][number]),
                    road_id=self._ids(int(vias["lane"][number]))[0],
                    required_speed=float(vias["required_speed"][number]),
                    hit=bool(vias["hit"][number]),
                )
                for number in range(int(vias["count"]))
            )
        )

    @cached_property
    def signals(self) -> tuple[t.SignalObservation, ...] | None:
        """The traffic lights ahead, nearest first."""
        lights = self.readings.get("signals")
        if lights is None:
            return None
        return tuple(
            t.SignalObservation(
                state=_LIGHTS[Signal(int(lights["state"][number]))],
                stop_point=Point(*lights["stop_point"][number].tolist()),
                controlled_lanes=(self._ids(int(lights["lane"][number]))[1],),
            )
            for number in range(int(lights["count"]))
        )

    @cached_property
    def lidar_point_cloud(self) -> t.LidarPointCloud | None:
        """Points, whether each ray met something, and the rays."""
        cloud = self.readings.get("lidar_point_cloud")
        if cloud is None:
            return None
        hits = cloud["hit"] != 0
        points = np.where(hits[:, None], cloud["point"], np.inf)
        ego = self.ego_vehicle_state
        origin = np.array([*ego.position[:2], ego.bounding_box.height + ABOVE_ROOF])
        return list(points), hits.tolist(), [(origin, ray) for ray in cloud["ray"].astype(np.float64)]

    @cached_property
    def drivable_area_grid_map(self) -> t.GridMap | None:
        """Where there is road."""
        return self._picture("drivable_area_grid_map")

    @cached_property
    def occupancy_grid_map(self) -> t.GridMap | None:
        """Where there are vehicles."""
        return self._picture("occupancy_grid_map")

    @cached_property
    def top_down_rgb(self) -> t.GridMap | None:
        """The scene in colour."""
        return self._picture("top_down_rgb")

    @cached_property
    def occlusion_map(self) -> t.GridMap | None:
        """What can be seen."""
        return self._picture("occlusion_map")

    @property
    def _mission(self) -> t.MissionObservation:
        mission = self.readings["mission"]
        goal = t.GoalObservation(
            GoalKind(int(mission["goal"])),
            Point(*mission["goal_position"].tolist()),
            float(mission["goal_radius"]),
        )
        return t.MissionObservation(
            goal,
            float(mission["route_length"]),
            float(mission["remaining"]),
            int(mission["laps"]),
            int(mission["lap"]),
        )

    @property
    def _lane_position(self) -> RefLinePoint | None:
        place = self.readings.get("lane_positions")
        return RefLinePoint(*_triple(place["lane_position"])) if place else None

    def _ids(self, lane: int) -> tuple[str, str]:
        """Return the ids of a lane's road and of the lane, empty where there is none."""
        if lane < 0:
            return "", ""
        return self.graph.edge_ids[int(self.graph.lane_edge[lane])], self.graph.lane_ids[lane]

    def _neighbour(self, near: Block, number: int, name: str) -> t.VehicleObservation:
        road_id, lane_id = self._ids(int(near["lane"][number]))
        return t.VehicleObservation(
            id=name,
            position=_triple(near["position"][number]),
            bounding_box=Dimensions(*_triple(near["bounding_box"][number])),
            heading=Heading(float(near["heading"][number])),
            speed=float(near["speed"][number]),
            road_id=road_id,
            lane_id=lane_id,
            lane_index=int(near["lane_index"][number]),
            lane_position=RefLinePoint(*_triple(near["lane_position"][number])),
        )

    def _waypoints(self, paths: Block, path: int, count: int) -> list[t.Waypoint]:
        return [
            t.Waypoint(
                pos=paths["position"][path, number],
                heading=Heading(float(paths["heading"][path, number])),
                lane_id=self.graph.lane_ids[int(paths["lane"][path, number])],
                lane_width=float(paths["lane_width"][path, number]),
                speed_limit=float(paths["speed_limit"][path, number]),
                lane_index=int(paths["lane_index"][path, number]),
                lane_offset=float(paths["lane_offset"][path, number]),
            )
            for number in range(count)
        ]

    def _picture(self, sensor: str) -> t.GridMap | None:
        picture = self.readings.get(sensor)
        if picture is None:
            return None
        height, width, _ = picture["data"].shape
        ego = self.ego_vehicle_state
        metadata = t.GridMapMetadata(
            float(picture["resolution"]), width, height, ego.position, float(ego.heading)
        )
        return t.GridMap(metadata, picture["data"])


def _triple(values: NDArray) -> tuple[float, float, float]:
    """Return the components of a vector in the plane or in space."""
    x, y, *rest = values.tolist()
    return x, y, rest[0] if rest else 0.0
