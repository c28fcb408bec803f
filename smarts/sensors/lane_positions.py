"""Where along and across its lane the agent's vehicle is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from smarts.agents.options import LanePositions
from smarts.arrays import Bools, Ints, Singles
from smarts.geometry.binding import bind
from smarts.geometry.compiling import kernel
from smarts.roads.scene import Scene
from smarts.sensors.bounds import FARTHEST, clipped
from smarts.sensors.protocol import Readings, Seen, triple
from smarts.types.agent_states import AgentStates
from smarts.types.coordinates import RefLinePoint
from smarts.types.interface import Field
from smarts.types.vehicles import VehicleStates


@dataclass(frozen=True)
class LanePosition:
    """The place in the lane as s, t, h: along the centreline, to its left, above the surface."""

    option: LanePositions = field(default_factory=LanePositions)

    def fields(self) -> tuple[Field, ...]:
        """Return what is reported."""
        meaning = "along the lane from its begin, to the left of its centreline, above it (always 0)"
        return (Field("lane_position", (3,), np.float32, -FARTHEST, FARTHEST, "m", meaning),)

    def bind(self, scene: Scene, agent_ids: Ints, out: Readings) -> Callable[[Bools], object]:
        """Return the function that writes the readings of the agents in its mask."""
        return bind(_observe, scene.world.agents, scene.world.vehicles, agent_ids, out["lane_position"])

    @staticmethod
    def as_object(readings: Readings, seen: Seen) -> RefLinePoint:
        """Return the place."""
        return RefLinePoint(*triple(readings["lane_position"]))


@kernel
def _observe(
    agents: AgentStates, vehicles: VehicleStates, agent_ids: Ints, out: Singles, observe_mask: Bools
) -> None:
    for b in range(observe_mask.shape[0]):
        for g in range(observe_mask.shape[1]):
            if observe_mask[b, g]:
                v = agents.slot[b, agent_ids[g]]
                out[b, g, 0] = clipped(vehicles.lane_position[b, v], FARTHEST)
                out[b, g, 1] = clipped(vehicles.lane_offset[b, v], FARTHEST)
                out[b, g, 2] = 0.0
