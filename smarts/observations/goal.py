"""The feature `goal`."""

from __future__ import annotations

import math
from collections.abc import Callable

from numpy.typing import NDArray

from smarts.arrays import Bools, Ints, Singles
from smarts.geometry.binding import bind
from smarts.geometry.compiling import kernel
from smarts.observations.feature import Feature
from smarts.observations.scales import GOAL_SCALE, compressed
from smarts.types.agent_states import AgentStates
from smarts.types.mission import Missions
from smarts.types.vehicles import VehicleStates


class Goal(Feature):
    """Position of the goal ahead and to the left, compressed; 0 without a goal."""

    size = 2

    def bind(self, *out: NDArray) -> Callable[[Bools], object]:
        """Return the function that observes."""
        world = self.context.scene.world
        return bind(_observe, world.agents, world.vehicles, world.missions, self.context.agent_ids, *out)


@kernel
def _observe(
    agents: AgentStates,
    vehicles: VehicleStates,
    missions: Missions,
    agent_ids: Ints,
    out: Singles,
    observe_mask: Bools,
) -> None:
    for b in range(observe_mask.shape[0]):
        for g in range(observe_mask.shape[1]):
            if not observe_mask[b, g]:
                continue
            a = agent_ids[g]
            own = agents.slot[b, a]
            out[b, g, 0], out[b, g, 1] = 0.0, 0.0
            if missions.goal[b, a] != 0:
                cos, sin = math.cos(vehicles.heading[b, own]), math.sin(vehicles.heading[b, own])
                dx = missions.goal_position[b, a, 0] - vehicles.position[b, own, 0]
                dy = missions.goal_position[b, a, 1] - vehicles.position[b, own, 1]
                out[b, g, 0] = compressed(dx * cos + dy * sin, GOAL_SCALE)
                out[b, g, 1] = compressed(dy * cos - dx * sin, GOAL_SCALE)
