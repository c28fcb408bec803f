"""How the motion of the agent's vehicle changes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from smarts.agents.options import Accelerometer
from smarts.geometry.compiling import kernel
from smarts.roads.scene import Scene
from smarts.sensors.bounds import HARDEST, HARDEST_JERK, HARDEST_TURN, HARDEST_TURN_JERK, clipped
from smarts.types.interface import Field

Bools = NDArray[np.bool_]
Ints = NDArray[np.int32]
Floats = NDArray[np.float64]
Singles = NDArray[np.float32]


@dataclass(frozen=True)
class AccelerationAndJerk:
    """Accelerations in the map frame, and how fast they changed since the step before.

    Those of agents' vehicles are of the centre of gravity, and the mean over the step. Jerk is 0 in a
    vehicle's first step, when there is nothing to compare with.
    """

    option: Accelerometer = field(default_factory=Accelerometer)

    def fields(self) -> tuple[Field, ...]:
        """Return what is reported."""
        single, turn, jerk = np.float32, HARDEST_TURN, HARDEST_JERK
        return (
            Field("linear_acceleration", (2,), single, -2 * HARDEST, 2 * HARDEST, "m/s^2", "along x and y"),
            Field("angular_acceleration", (), single, -turn, turn, "rad/s^2", "counter-clockwise"),
            Field("linear_jerk", (2,), single, -jerk, jerk, "m/s^3", "along x and y"),
            Field(
                *("angular_jerk", (), single, -HARDEST_TURN_JERK, HARDEST_TURN_JERK),
                *("rad/s^3", "counter-clockwise"),
            ),
        )

    def observe(self, scene: Scene, agent_ids: Ints, observe_mask: Bools, out: Mapping[str, NDArray]) -> None:
        """Write the readings of the wanted agents."""
        now, before = scene.world.vehicles, scene.world.before
        _observe(
            agent_ids,
            observe_mask,
            scene.world.agents.slot,
            scene.world.dt,
            now.generation,
            now.heading,
            now.acceleration,
            now.lateral_acceleration,
            now.yaw_acceleration,
            before.generation,
            before.heading,
            before.acceleration,
            before.lateral_acceleration,
            before.yaw_acceleration,
            out["linear_acceleration"],
            out["angular_acceleration"],
            out["linear_jerk"],
            out["angular_jerk"],
        )


@kernel
def _in_map(heading: float, along: float, across: float) -> tuple[float, float]:
    """Return the components along x and y of an acceleration along and across a heading."""
    along, across = clipped(along, HARDEST), clipped(across, HARDEST)
    cosine, sine = math.cos(heading), math.sin(heading)
    return along * cosine - across * sine, along * sine + across * cosine


@kernel
def _observe(
    agent_ids: Ints,
    observe_mask: Bools,
    slots: Ints,
    dt: float,
    generation: Ints,
    heading: Floats,
    along: Floats,
    across: Floats,
    turn: Floats,
    generation_before: Ints,
    heading_before: Floats,
    along_before: Floats,
    across_before: Floats,
    turn_before: Floats,
    acceleration_out: Singles,
    turn_out: Singles,
    jerk_out: Singles,
    turn_jerk_out: Singles,
) -> None:
    for b in range(observe_mask.shape[0]):
        for g in range(observe_mask.shape[1]):
            if not observe_mask[b, g]:
                continue
            v = slots[b, agent_ids[g]]
            x, y = _in_map(heading[b, v], along[b, v], across[b, v])
            acceleration_out[b, g, 0] = clipped(x, 2 * HARDEST)
            acceleration_out[b, g, 1] = clipped(y, 2 * HARDEST)
            turn_out[b, g] = clipped(turn[b, v], HARDEST_TURN)
            if generation[b, v] == generation_before[b, v]:
                x_before, y_before = _in_map(heading_before[b, v], along_before[b, v], across_before[b, v])
                jerk_out[b, g, 0] = clipped((x - x_before) / dt, HARDEST_JERK)
                jerk_out[b, g, 1] = clipped((y - y_before) / dt, HARDEST_JERK)
                turn_jerk_out[b, g] = clipped((turn[b, v] - turn_before[b, v]) / dt, HARDEST_TURN_JERK)
            else:
                jerk_out[b, g, 0], jerk_out[b, g, 1], turn_jerk_out[b, g] = 0.0, 0.0, 0.0
