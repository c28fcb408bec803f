"""Missions as arrays: each agent's route, goal and task."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import NamedTuple

from smarts.arrays import Bytes, Floats, Ints, Shorts
from smarts.types import columns


class GoalKind(enum.IntEnum):
    """How the goal is reached."""

    ENDLESS = 0
    """Has no goal."""
    POSITION = 1
    """The centre within a radius of a point."""
    LANE_LINE = 2
    """Across a line in the goal lane."""
    LAPS = 3
    """Across the goal line as often as there are laps."""
    OFF_MAP = 4
    """Off the map at the end of a road."""


class TaskKind(enum.IntEnum):
    """A manoeuvre that the agent is led through on its way."""

    NONE = 0
    U_TURN = 1
    """On to the road of the other direction."""
    CUT_IN = 2
    """In front of a vehicle in the lane beside."""


@dataclass(frozen=True)
class Task:
    """A manoeuvre of one mission; see `smarts.sstudio.types.UTurn` and `CutIn`."""

    kind: TaskKind = TaskKind.NONE
    radius: float = 0.0
    """Distance within which another vehicle triggers it [m]."""
    lane: int = -1
    """U-turn: the lane to turn into. Cut-in: a lane of the edge at which the task ends. -1 for none."""
    speed: float = 0.0
    """Speed before the manoeuvre [m/s]; 0: the speed limit."""


@dataclass(frozen=True)
class Via:
    """A point to pass on the way."""

    position: tuple[float, float]
    """[m]"""
    lane: int
    radius: float
    """Distance within which it counts as passed [m]."""
    speed: float
    """Required speed at the point [m/s]."""


@dataclass(frozen=True)
class AgentMission:
    """One agent's mission in one episode, on its map."""

    route: tuple[str, ...] = ()
    """Ids of road edges from the start to the goal, all laps."""
    goal: GoalKind = GoalKind.ENDLESS
    goal_position: tuple[float, float] = (0.0, 0.0)
    """[m]"""
    goal_radius: float = 2.0
    """[m]"""
    goal_lane: int = -1
    goal_s: float = 0.0
    """Arc length of the goal on its lane [m]."""
    laps: int = 1
    route_length: float = 0.0
    """Length from the start to the goal [m]; 0 for endless missions."""
    free_flow_time: float = 0.0
    """What the route takes at the limits, from the start's speed [s]."""
    vias: tuple[Via, ...] = field(default=())
    task: Task = Task()


_NONE_IS_MINUS_ONE = ("route", "goal_lane", "task_lane", "via_lane")


class Missions(NamedTuple):
    """The missions of B simulations, shape (B, A); written when an agent gets its column."""

    route: Ints
    """Number of the route in its simulation, as `VehicleStates.route`; -1 without one."""
    goal: Bytes
    """A `GoalKind`."""
    goal_position: Floats
    """[m], shape (B, A, 2)."""
    goal_radius: Floats
    """[m]"""
    goal_lane: Ints
    """-1 without a goal on a lane."""
    goal_s: Floats
    """[m]"""
    laps: Shorts
    route_length: Floats
    """[m]"""
    free_flow_time: Floats
    """[s]"""
    task: Bytes
    """A `TaskKind`."""
    task_radius: Floats
    """[m]"""
    task_lane: Ints
    """-1 for none."""
    task_speed: Floats
    """[m/s], 0 where the task does not say."""
    via_count: Ints
    """How many of the via points there are."""
    via_position: Floats
    """[m], shape (B, A, W, 2)."""
    via_lane: Ints
    """Shape (B, A, W)."""
    via_radius: Floats
    """[m], shape (B, A, W)."""
    via_speed: Floats
    """[m/s], shape (B, A, W)."""

    @classmethod
    def allocate(cls, worlds: int, agents: int, vias: int = 0) -> Missions:
        """Return endless missions for B simulations of A agents and W via points."""
        more = {"goal_position": (2,), "via_position": (vias, 2)}
        more |= dict.fromkeys(("via_lane", "via_radius", "via_speed"), (vias,))
        return columns.allocate(cls, (worlds, agents), _NONE_IS_MINUS_ONE, more)

    def write(self, row: int, agent_id: int, mission: AgentMission, route: int) -> None:
        """Write an agent's mission; `route` is the number that its simulation gave to the route."""
        self.clear(row, agent_id)
        self.route[row, agent_id] = route
        goal = ("goal", "goal_position", "goal_radius", "goal_lane", "goal_s", "laps")
        for name in (*goal, "route_length", "free_flow_time"):
            getattr(self, name)[row, agent_id] = getattr(mission, name)
        self.task[row, agent_id] = mission.task.kind
        for name in ("radius", "lane", "speed"):
            getattr(self, f"task_{name}")[row, agent_id] = getattr(mission.task, name)
        self.via_count[row, agent_id] = len(mission.vias)
        for number, via in enumerate(mission.vias):
            self.via_position[row, agent_id, number] = via.position
            self.via_lane[row, agent_id, number] = via.lane
            self.via_radius[row, agent_id, number] = via.radius
            self.via_speed[row, agent_id, number] = via.speed

    def clear(self, row: int, agent_id: int | slice = slice(None)) -> None:
        """Make missions of one simulation endless."""
        columns.clear(self, (row, agent_id), _NONE_IS_MINUS_ONE)
