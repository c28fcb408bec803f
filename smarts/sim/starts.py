"""Starts: a scenario's missions as the agents of one episode, with routes, goals and distances on the map."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from smarts.agents.interface import AgentInterface
from smarts.arrays import Floats
from smarts.dynamics import vehicle
from smarts.errors import MapError, ScenarioError
from smarts.geometry.boxes import boxes_overlap
from smarts.geometry.rings import rings_of
from smarts.roads.atlas import ROAD_LANES
from smarts.roads.corridors import Corridor, route_corridor
from smarts.roads.lane_graph import HEIGHT_REACH, LaneGraph
from smarts.roads.memory import remembered
from smarts.sstudio import sstypes as t
from smarts.sstudio.missions import PlacedMission, PlacedVia, place_missions
from smarts.sstudio.placement import target_lane
from smarts.sstudio.sstypes.drawing import fresh_drawing
from smarts.types.episode import AgentStart, TakeOver
from smarts.types.mission import AgentMission, GoalKind, Task, TaskKind, Via
from smarts.types.vehicles import VehicleKind

if TYPE_CHECKING:
    from numpy.random import Generator

    from smarts.sstudio.built import BuiltScenario

TRIES = 20
"""How often starts are drawn until no two egos overlap."""
GOAL_RADIUS = 2.0
"""[m]"""
LEAST_ROUTE = 1.0
"""How far ahead of its vehicle's centre a goal has to be [m]."""
TRAP_LENGTH = 20.0
"""Length of the trap before and behind a start, unless the scenario names one [m]."""
TRAP_BEHIND = 5.0
"""How much of that area lies before the start [m]."""
_ACCELERATION = 3.0
"""Acceleration with which an undisturbed driver reaches the limit [m/s^2]."""


@dataclass(frozen=True)
class Shape:
    """An agent's vehicle."""

    kind: VehicleKind = VehicleKind.PASSENGER
    length: float = 5.0
    """[m]"""
    width: float = 1.8
    """[m]"""

    @property
    def vehicle_class(self) -> str:
        """SUMO's class of the vehicle."""
        return VehicleKind(self.kind).name.lower()


def shape_of(interface: AgentInterface) -> Shape:
    """Return the vehicle of an agent."""
    kind = interface.vehicle_kind
    parameters = vehicle(VehicleKind(kind).name.lower())
    return Shape(kind, parameters.length, parameters.width)


def draw_starts(
    built: BuiltScenario,
    missions: Sequence[t.AnyMission],
    names: Sequence[str],
    shapes: Sequence[Shape],
    generator: Generator,
) -> tuple[AgentStart, ...]:
    """Draw the egos' starts of one episode, again while two overlap or a goal is not ahead of its start.

    Args:
        built: The scenario.
        missions: One for each ego.
        names: The agents', one for each ego.
        shapes: Their vehicles'.
        generator: Draws random routes and the variation of starts.

    Raises:
        ScenarioError: A mission cannot be on the map, or no draw makes a start.
    """
    roads, problem = built.roads(), ""
    for _ in range(TRIES):
        placed = place_agents(built, missions, shapes, generator, built.scenario.start_variation, built.name)
        starts = tuple(
            agent_start(mission, roads, name, shape, generator)
            for mission, name, shape in zip(placed, names, shapes, strict=True)
        )
        problem = _problem(starts)
        if not problem:
            return starts
    raise ScenarioError(
        f"{problem}, in all of {TRIES} draws",
        place=built.name,
        remedy="move the missions' starts and goals apart, or vary the starts less",
    )


def place_agents(
    built: BuiltScenario,
    missions: Sequence[t.AnyMission],
    shapes: Sequence[Shape],
    generator: Generator,
    variation: t.StartVariation | None,
    place: str,
) -> tuple[PlacedMission, ...]:
    """Draw agents' missions of one episode, on ways that are open to their vehicles; see `place_missions`."""
    return place_missions(
        missions,
        built.roads(),
        generator,
        variation,
        vehicle_length=max((shape.length for shape in shapes), default=Shape().length),
        kinds=[shape.vehicle_class for shape in shapes],
        net=built.net_file,
        place=place,
    )


def _problem(starts: Sequence[AgentStart]) -> str:
    """Return why these starts are invalid, "" if they are valid."""
    for start in starts:
        if not is_ahead(start):
            return f"the goal of {start.name!r} is not ahead of its start"
    for first, second in itertools.combinations(starts, 2):
        if overlap(first, second):
            return f"the starts of {first.name!r} and {second.name!r} overlap"
    return ""


def is_ahead(start: AgentStart) -> bool:
    """Return whether an agent's goal is ahead of its start."""
    return not start.mission.route or start.mission.route_length >= LEAST_ROUTE


def overlap(first: AgentStart, second: AgentStart) -> bool:
    """Return whether two agents' vehicles overlap when the episode begins."""
    are_there = all(start.entry_time <= 0 and not start.take_over for start in (first, second))
    reach = 0.5 * (math.hypot(first.length, first.width) + math.hypot(second.length, second.width))
    are_there = are_there and not abs(first.height - second.height) > HEIGHT_REACH
    if not are_there or math.dist(first.pose[:2], second.pose[:2]) > reach:
        return False
    return bool(boxes_overlap(*_box(first), *_box(second)).any())


def _box(start: AgentStart) -> tuple[NDArray, NDArray, NDArray]:
    """Return centre, heading and size."""
    return np.array(start.pose[:2]), np.array(start.pose[2]), np.array([start.length, start.width])


def agent_start(
    placed: PlacedMission, roads: LaneGraph, name: str, shape: Shape, generator: Generator
) -> AgentStart:
    """Return the start of one agent.

    Args:
        placed: Its mission.
        roads: The map.
        name: Its name.
        shape: Shape of its vehicle.
        generator: Draws where an area with a random offset begins in which it takes a vehicle over.
    """
    return AgentStart(
        name=name,
        pose=placed.start.pose(roads, behind=shape.length / 2),
        height=roads.height_at(placed.start.lane, placed.start.s),
        speed=placed.speed,
        mission=_agent_mission(placed, roads, shape),
        kind=shape.kind,
        length=shape.length,
        width=shape.width,
        entry_time=placed.start_time,
        take_over=_take_over(placed, roads, generator),
    )


def _agent_mission(placed: PlacedMission, roads: LaneGraph, shape: Shape) -> AgentMission:
    vias = tuple(_via(via, roads) for via in placed.via)
    if placed.goal is None:
        return AgentMission(vias=vias)
    mission = placed.mission
    laps = mission.num_laps if isinstance(mission, t.LapMission) else 1
    x, y, _ = placed.goal.pose(roads)
    route = placed.route if _is_drivable(roads, placed.route) else ()
    length = 0.0
    if route:
        corridor = corridor_of(roads, route)
        begin = distance_along(corridor, roads, placed.start.lane, placed.start.s - shape.length / 2)
        length = distance_along(corridor, roads, placed.goal.lane, placed.goal.s, last=True) - begin
    return AgentMission(
        route=route,
        goal=GoalKind.LAPS if isinstance(mission, t.LapMission) else GoalKind.POSITION,
        goal_position=(x, y),
        goal_radius=GOAL_RADIUS,
        goal_lane=placed.goal.lane,
        goal_s=placed.goal.s,
        laps=laps,
        route_length=length,
        free_flow_time=free_flow_time(roads, route, placed.start.lane, length, placed.speed),
        vias=vias,
        task=_task(placed, roads),
    )


def _is_drivable(roads: LaneGraph, route: tuple[str, ...]) -> bool:
    """Return whether each edge leads into the next; those of a U-turn in the middle of a road do not."""
    try:
        corridor_of(roads, route)
    except MapError:
        return False
    return True


def corridor_of(roads: LaneGraph, route: tuple[str, ...]) -> Corridor:
    """Return the corridor that vehicles of agents are measured on."""
    return route_corridor(roads, route, ROAD_LANES)


def distance_along(corridor: Corridor, roads: LaneGraph, lane: int, s: float, *, last: bool = False) -> float:
    """Return the distance along a route of a place on a lane [m], NaN off the route.

    Args:
        corridor: Corridor of the route.
        roads: The map.
        lane: The lane.
        s: Arc length on it [m].
        last: Which time counts where the route uses the lane more than once.
    """
    rows = np.flatnonzero(corridor.lane == lane)
    if not len(rows):
        return math.nan
    row = rows[np.argmax(corridor.end[rows]) if last else np.argmin(corridor.begin[rows])]
    share = min(1.0, max(0.0, s / float(roads.length[lane])))
    return float(corridor.begin[row] + share * (corridor.end[row] - corridor.begin[row]))


def free_flow_time(roads: LaneGraph, route: tuple[str, ...], lane: int, length: float, speed: float) -> float:
    """Return how long a driver at the limits takes for a route, from a speed at its start [s]."""
    if not route:
        return 0.0
    return time_at(mean_limit(roads, route), float(roads.speed_limit[lane]), length, speed)


@remembered(most=1024)
def mean_limit(roads: LaneGraph, route: tuple[str, ...]) -> float:
    """Return the mean speed of a driver at the limits over a route [m/s]."""
    edges = [roads.edge_number(name) for name in route]
    rightmost = [_rightmost_road_lane(roads, edge) for edge in edges]
    lengths, limits = roads.length[rightmost], roads.speed_limit[rightmost]
    return float(lengths.sum() / (lengths / limits).sum())


def _rightmost_road_lane(roads: LaneGraph, edge: int) -> int:
    """Return the rightmost lane for vehicles: beside it there may be a sidewalk or a bicycle lane."""
    lanes = roads.edge_lanes(edge)
    return next((lane for lane in lanes if roads.kind[lane] in ROAD_LANES), lanes[0])


def time_at(mean: float, limit: float, length: float, speed: float) -> float:
    """Return how long a driver takes for a length [m] at a mean speed, from a speed at its start [s].

    Args:
        mean: See `mean_limit` [m/s].
        limit: Speed limit of the lane at the start [m/s].
        length: [m]
        speed: [m/s]
    """
    return length / mean + max(0.0, limit - speed) ** 2 / (2 * _ACCELERATION * limit)


def _via(via: PlacedVia, roads: LaneGraph) -> Via:
    x, y, _ = via.point.pose(roads)
    return Via((x, y), via.point.lane, via.hit_distance, via.required_speed)


def _task(placed: PlacedMission, roads: LaneGraph) -> Task:
    task = placed.mission.task if isinstance(placed.mission, t.Mission) else None
    if isinstance(task, t.UTurn):
        lane = target_lane(roads, placed.route[-1], task)
        return Task(TaskKind.U_TURN, task.trigger_radius, lane, task.initial_speed or 0.0)
    if isinstance(task, t.CutIn):
        edge_id, lane = task.complete_on_edge_id, -1
        if edge_id is not None:
            name = edge_id.to_edge(roads) if isinstance(edge_id, t.JunctionEdgeIDResolver) else edge_id
            lane = int(roads.edge_first_lane[roads.edge_number(name)])
        return Task(TaskKind.CUT_IN, task.trigger_radius, lane)
    return Task()


def _take_over(placed: PlacedMission, roads: LaneGraph, generator: Generator) -> TakeOver | None:
    tactic = placed.mission.entry_tactic
    if not isinstance(tactic, t.IdEntryTactic | t.TrapEntryTactic):
        return None
    if isinstance(tactic, t.IdEntryTactic):
        return TakeOver(vehicle=tactic.actor_id, condition=tactic.condition)
    return TakeOver(
        areas=_trap_areas(tactic, placed, roads, generator),
        spared=tuple(tactic.exclusion_prefixes),
        patience=tactic.wait_to_hijack_limit_s,
        condition=tactic.condition,
    )


def _trap_areas(
    tactic: t.TrapEntryTactic, placed: PlacedMission, roads: LaneGraph, generator: Generator
) -> tuple[Floats, ...]:
    zone = tactic.zone
    if zone is None:
        lane = placed.start.lane
        edge, index = roads.edge_ids[roads.lane_edge[lane]], int(roads.lane_index[lane])
        scale = roads.sumo_length[lane] / roads.length[lane]  # zones are in SUMO's positions
        begin = max(0.0, placed.start.s - TRAP_BEHIND)
        zone = t.MapZone((edge, index, begin * scale), TRAP_LENGTH * scale, 1)
    with fresh_drawing(generator=generator):
        return rings_of(zone.to_geometry(roads))
