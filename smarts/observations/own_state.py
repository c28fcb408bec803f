"""Features of an agent's own state: `goal`, `lane_offset`, `speed`, `steering` and others."""

from __future__ import annotations

import math

import numpy as np

from smarts.agents.interface import AgentInterface
from smarts.arrays import Floats, Ints, Singles
from smarts.geometry.compiling import kernel
from smarts.observations.feature import Feature
from smarts.observations.scales import (
    GOAL_SCALE,
    MOST_LANE_CHANGES,
    SPEED_SCALE,
    STEERING_SCALE,
    clipped,
    compressed,
)
from smarts.roads.arrays import Roads, RouteTable
from smarts.types.agent_states import AgentStatus
from smarts.types.world import State

_ACTIVE = int(AgentStatus.ACTIVE)


class Goal(Feature):
    """Position of the goal ahead and to the left, compressed; 0 without a goal."""

    size = 2

    @staticmethod
    @kernel
    def write(state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: Singles) -> None:
        """Write an agent's numbers; see `Feature`."""
        vehicles, missions = state.vehicles, state.missions
        own = state.agents.slot[b, a]
        out[0], out[1] = 0.0, 0.0
        if missions.goal[b, a] != 0:
            cos, sin = math.cos(vehicles.heading[b, own]), math.sin(vehicles.heading[b, own])
            dx = missions.goal_position[b, a, 0] - vehicles.position[b, own, 0]
            dy = missions.goal_position[b, a, 1] - vehicles.position[b, own, 1]
            out[0] = compressed(dx * cos + dy * sin, GOAL_SCALE)
            out[1] = compressed(dy * cos - dx * sin, GOAL_SCALE)


class LaneOffset(Feature):
    """Distance to the left of the lane's centreline, in widths of the lane; 0 without a lane."""

    @staticmethod
    @kernel
    def write(state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: Singles) -> None:
        """Write an agent's numbers; see `Feature`."""
        own = state.agents.slot[b, a]
        lane = state.vehicles.lane[b, own]
        out[0] = 0.0
        if lane >= 0:
            width = roads.lane_width[roads.lane_base[state.map[b]] + lane]
            out[0] = clipped(state.vehicles.lane_offset[b, own] / width)


class Speed(Feature):
    """Speed along the heading, in units of 30 m/s."""

    @staticmethod
    @kernel
    def write(state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: Singles) -> None:
        """Write an agent's numbers; see `Feature`."""
        own = state.agents.slot[b, a]
        out[0] = clipped(state.vehicles.speed[b, own] / SPEED_SCALE)


class Steering(Feature):
    """Angle of the front wheels, positive to the left, in units of 0.6 rad."""

    @staticmethod
    @kernel
    def write(state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: Singles) -> None:
        """Write an agent's numbers; see `Feature`."""
        out[0] = clipped(state.agents.steering[b, a] / STEERING_SCALE)


class LaneChanges(Feature):
    """Lane changes that the route still demands, in thirds; positive where the first is to the left."""

    @staticmethod
    @kernel
    def write(state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: Singles) -> None:
        """Write an agent's numbers; see `Feature`."""
        out[0] = clipped(state.agents.lane_changes[b, a] / MOST_LANE_CHANGES)


class TimeStood(Feature):
    """Time at a standstill, as a share of the time that ends the agent's episode; 0 if none does."""

    def known(self) -> tuple[Floats]:
        """Return the steps at a standstill that end each agent's episode."""
        dt = self.context.scene.world.dt
        return (np.array([_limit(interface, dt) for interface in self.context.interfaces]),)

    @staticmethod
    @kernel
    def write(
        state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: Singles, limits: Floats
    ) -> None:
        """Write an agent's numbers; see `Feature`."""
        stood = state.step[b] - state.agents.last_moved_step[b, a]
        out[0] = min(1.0, stood / limits[g])


def _limit(interface: AgentInterface, dt: float) -> float:
    """Return the steps at a standstill that end an agent's episode, infinite if none do."""
    if not interface.done_criteria.not_moving:
        return np.inf
    return max(1.0, interface.event_configuration.not_moving_time / dt)


class AgentIndex(Feature):
    """One-hot: which of the agents the agent is."""

    @classmethod
    def size_for(cls, agents: int) -> int:
        """Return one number for each agent."""
        return agents

    @staticmethod
    @kernel
    def write(state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: Singles) -> None:
        """Write an agent's numbers; see `Feature`."""
        out[g] = 1.0


class ArrivalOrder(Feature):
    """The share of the other agents that came to the junction ahead before; -1 away from junctions."""

    def known(self) -> tuple[Ints]:
        """Return the agents that are observed together."""
        return (self.context.agent_ids,)

    @staticmethod
    @kernel
    def write(
        state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: Singles, agent_ids: Ints
    ) -> None:
        """Write an agent's numbers; see `Feature`."""
        agents, earlier = state.agents, 0
        if agents.arrival_number[b, a] < 0:
            out[0] = -1.0
            return
        for other in agent_ids:
            is_here = agents.state[b, other] == _ACTIVE and agents.arrival_number[b, other] >= 0
            if is_here and agents.arrival_junction[b, other] == agents.arrival_junction[b, a]:
                earlier += agents.arrival_number[b, other] < agents.arrival_number[b, a]
        out[0] = earlier / max(len(agent_ids) - 1, 1)
