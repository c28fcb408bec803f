"""Where the agent is bound for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from smarts.geometry.compiling import kernel
from smarts.roads.scene import Scene
from smarts.sensors.bounds import FARTHEST, MOST, clipped, clipped_above
from smarts.types.interface import Field
from smarts.types.mission import GoalKind

Bools = NDArray[np.bool_]
Bytes = NDArray[np.int8]
Ints = NDArray[np.int32]
Shorts = NDArray[np.int16]
Floats = NDArray[np.float64]
Singles = NDArray[np.float32]


@dataclass(frozen=True)
class MissionAndGoal:
    """The goal, how far it is along the route, and the laps."""

    def fields(self) -> tuple[Field, ...]:
        """Return what is reported."""
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

    def observe(self, scene: Scene, agent_ids: Ints, observe_mask: Bools, out: Mapping[str, NDArray]) -> None:
        """Write the readings of the wanted agents."""
        missions, states = scene.world.missions, scene.world.agents
        _observe(
            agent_ids,
            observe_mask,
            missions.goal,
            missions.goal_position,
            missions.goal_radius,
            missions.route_length,
            states.remaining,
            missions.laps,
            states.lap,
            out["goal"],
            out["goal_position"],
            out["goal_radius"],
            out["route_length"],
            out["remaining"],
            out["laps"],
            out["lap"],
        )


@kernel
def _observe(
    agent_ids: Ints,
    observe_mask: Bools,
    goal: Bytes,
    goal_position: Floats,
    goal_radius: Floats,
    route_length: Floats,
    remaining: Floats,
    laps: Shorts,
    lap: Shorts,
    goal_out: Bytes,
    goal_position_out: Floats,
    goal_radius_out: Singles,
    route_length_out: Singles,
    remaining_out: Singles,
    laps_out: Ints,
    lap_out: Ints,
) -> None:
    for b in range(observe_mask.shape[0]):
        for g in range(observe_mask.shape[1]):
            if observe_mask[b, g]:
                a = agent_ids[g]
                goal_out[b, g] = goal[b, a]
                goal_position_out[b, g, 0] = clipped(goal_position[b, a, 0], FARTHEST)
                goal_position_out[b, g, 1] = clipped(goal_position[b, a, 1], FARTHEST)
                goal_radius_out[b, g] = clipped_above(goal_radius[b, a], FARTHEST)
                route_length_out[b, g] = clipped_above(route_length[b, a], FARTHEST)
                remaining_out[b, g] = clipped_above(remaining[b, a], FARTHEST)
                laps_out[b, g], lap_out[b, g] = laps[b, a], lap[b, a]
