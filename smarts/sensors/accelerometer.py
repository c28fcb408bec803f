"""How the motion of the agent's vehicle changes."""

from __future__ import annotations

import math
from collections import namedtuple
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

import numpy as np

from smarts.agents.options import Accelerometer
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.sensors.bounds import HARDEST, HARDEST_JERK, HARDEST_TURN, HARDEST_TURN_JERK, clipped
from smarts.sensors.protocol import KernelSensor, Readings, Seen, Triple, triple
from smarts.types.interface import Field
from smarts.types.vehicles import VehicleStates
from smarts.types.world import State


class MotionChange(NamedTuple):
    """Accelerations and jerks in the map frame."""

    linear_acceleration: Triple
    """[m/s^2]"""
    angular_acceleration: Triple
    """[rad/s^2]"""
    linear_jerk: Triple
    """[m/s^3]"""
    angular_jerk: Triple
    """[rad/s^3]"""


_Out = namedtuple("_Out", "linear_acceleration angular_acceleration linear_jerk angular_jerk")


@dataclass(frozen=True)
class AccelerationAndJerk(KernelSensor):
    """Accelerations in the map frame, and how fast they changed since the step before.

    Those of agents' vehicles are of the centre of gravity, and the mean over the step. Jerk is 0 in a
    vehicle's first step, when there is nothing to compare with.
    """

    option: Accelerometer = field(default_factory=Accelerometer)
    arrays: ClassVar[type] = _Out

    def fields(self) -> tuple[Field, ...]:
        """Return the fields."""
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

    @staticmethod
    @kernel
    def write(state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: _Out) -> None:
        """Write an agent's readings; see `KernelSensor`."""
        vehicles, before, v = state.vehicles, state.before, state.agents.slot[b, a]
        x, y = _in_map(vehicles, b, v)
        turn = vehicles.yaw_acceleration[b, v]
        out.linear_acceleration[b, g, 0] = clipped(x, 2 * HARDEST)
        out.linear_acceleration[b, g, 1] = clipped(y, 2 * HARDEST)
        out.angular_acceleration[b, g] = clipped(turn, HARDEST_TURN)
        if vehicles.generation[b, v] == before.generation[b, v]:
            x_before, y_before = _in_map(before, b, v)
            turn_before = before.yaw_acceleration[b, v]
            out.linear_jerk[b, g, 0] = clipped((x - x_before) / state.dt, HARDEST_JERK)
            out.linear_jerk[b, g, 1] = clipped((y - y_before) / state.dt, HARDEST_JERK)
            out.angular_jerk[b, g] = clipped((turn - turn_before) / state.dt, HARDEST_TURN_JERK)
        else:
            out.linear_jerk[b, g, 0], out.linear_jerk[b, g, 1] = 0.0, 0.0
            out.angular_jerk[b, g] = 0.0

    @staticmethod
    def as_object(readings: Readings, seen: Seen) -> MotionChange:
        """Return the readings as vectors in space."""
        return MotionChange(
            triple(readings["linear_acceleration"]),
            (0.0, 0.0, float(readings["angular_acceleration"])),
            triple(readings["linear_jerk"]),
            (0.0, 0.0, float(readings["angular_jerk"])),
        )


@kernel
def _in_map(vehicles: VehicleStates, b: int, v: int) -> tuple[float, float]:
    """Return a vehicle's acceleration along x and y."""
    along = clipped(vehicles.acceleration[b, v], HARDEST)
    across = clipped(vehicles.lateral_acceleration[b, v], HARDEST)
    cosine, sine = math.cos(vehicles.heading[b, v]), math.sin(vehicles.heading[b, v])
    return along * cosine - across * sine, along * sine + across * cosine
