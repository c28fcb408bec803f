"""The feature `goal`."""

from __future__ import annotations

import math

from smarts.arrays import Ints, Singles
from smarts.geometry.compiling import kernel
from smarts.observations.feature import Feature
from smarts.observations.scales import GOAL_SCALE, compressed
from smarts.roads.arrays import Roads, RouteTable
from smarts.types.world import State


class Goal(Feature):
    """Position of the goal ahead and to the left, compressed; 0 without a goal."""

    size = 2

    @staticmethod
    @kernel
    def write(
        state: State, roads: Roads, routes: RouteTable, agent_ids: Ints, b: int, g: int, out: Singles
    ) -> None:
        """Write an agent's numbers; see `Feature`."""
        vehicles, missions, a = state.vehicles, state.missions, agent_ids[g]
        own = state.agents.slot[b, a]
        out[0], out[1] = 0.0, 0.0
        if missions.goal[b, a] != 0:
            cos, sin = math.cos(vehicles.heading[b, own]), math.sin(vehicles.heading[b, own])
            dx = missions.goal_position[b, a, 0] - vehicles.position[b, own, 0]
            dy = missions.goal_position[b, a, 1] - vehicles.position[b, own, 1]
            out[0] = compressed(dx * cos + dy * sin, GOAL_SCALE)
            out[1] = compressed(dy * cos - dx * sin, GOAL_SCALE)
