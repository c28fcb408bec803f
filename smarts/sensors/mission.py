"""The agent's mission: goal, remaining distance and laps."""

from __future__ import annotations

from collections import namedtuple
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.sensors.bounds import FARTHEST, MOST, clipped, clipped_above
from smarts.sensors.protocol import KernelSensor, Readings, Seen
from smarts.types.coordinates import Point
from smarts.types.interface import Field
from smarts.types.mission import GoalKind
from smarts.types.world import State


class GoalObservation(NamedTuple):
    """Where a mission ends."""

    kind: GoalKind
    position: Point
    """[m]; the origin if the goal is no place."""
    radius: float
    """[m]"""

    def is_specific(self) -> bool:
        """Return whether the goal is a place."""
        return self.kind not in (GoalKind.ENDLESS, GoalKind.OFF_MAP)


class MissionObservation(NamedTuple):
    """The agent's goal, and how much of the way is left."""

    goal: GoalObservation
    route_length: float
    """From start to goal [m]; 0 if there is no end."""
    remaining: float
    """What remains of the route [m]."""
    laps: int
    lap: int
    """Laps completed."""


_Out = namedtuple("_Out", "goal goal_position goal_radius route_length remaining laps lap")


@dataclass(frozen=True)
class MissionAndGoal(KernelSensor):
    """The goal, how far it is along the route, and the laps."""

    arrays: ClassVar[type] = _Out

    def fields(self) -> tuple[Field, ...]:
        """Return the fields."""
        kinds = ", ".join(f"{kind.value} {kind.name.lower()}" for kind in GoalKind)
        return (
            Field("goal", (), np.int8, 0, max(GoalKind), "", f"what it takes to arrive: {kinds}"),
            Field("goal_position", (2,), np.float64, -FARTHEST, FARTHEST, "m", "0 if the goal is no place"),
            Field("goal_radius", (), np.float32, 0, FARTHEST, "m", "within which a position counts"),
            Field("route_length", (), np.float32, 0, FARTHEST, "m", "from start to goal, 0 if endless"),
            Field(
                "remaining", (), np.float32, 0, FARTHEST, "m", "of the route; the last value off the route"
            ),
            Field("laps", (), np.int32, 0, MOST, "", "to be driven"),
            Field("lap", (), np.int32, 0, MOST, "", "laps completed"),
        )

    @staticmethod
    @kernel
    def write(state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: _Out) -> None:
        """Write an agent's readings; see `KernelSensor`."""
        missions, agents = state.missions, state.agents
        out.goal[b, g] = missions.goal[b, a]
        out.goal_position[b, g, 0] = clipped(missions.goal_position[b, a, 0], FARTHEST)
        out.goal_position[b, g, 1] = clipped(missions.goal_position[b, a, 1], FARTHEST)
        out.goal_radius[b, g] = clipped_above(missions.goal_radius[b, a], FARTHEST)
        out.route_length[b, g] = clipped_above(missions.route_length[b, a], FARTHEST)
        out.remaining[b, g] = clipped_above(agents.remaining[b, a], FARTHEST)
        out.laps[b, g], out.lap[b, g] = missions.laps[b, a], agents.lap[b, a]

    @staticmethod
    def as_object(readings: Readings, seen: Seen) -> MissionObservation:
        """Return the mission."""
        goal = GoalObservation(
            GoalKind(int(readings["goal"])),
            Point(*readings["goal_position"].tolist()),
            float(readings["goal_radius"]),
        )
        length, left = float(readings["route_length"]), float(readings["remaining"])
        return MissionObservation(goal, length, left, int(readings["laps"]), int(readings["lap"]))
