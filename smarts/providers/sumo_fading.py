"""What is left of a vehicle's last pose when SUMO drives it again fades, so that it does not jump.

SUMO shows a vehicle with both ends on its lane; an agent's vehicle drives on its tyres. In a bend, a bus's
heading differs by some hundredths, and its middle by some decimetres. For the steps after a hand-over the
world's pose is SUMO's plus a remainder along and across the lane and in heading, which shrinks to zero. SUMO
may drop the vehicle's offset from its lane at once, where it enters the next lane: as long as the vehicle may
have one, a jump across the lane goes to the remainder.
"""

from __future__ import annotations

import math
from collections.abc import Container

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools, Floats
from smarts.geometry.binding import bind
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import wrapped
from smarts.types.vehicles import VehicleStates
from smarts.types.world import World

ALONG = 0.03
"""Decrease of the remainder along the lane in a step [m]."""
ASIDE = 0.04
"""Decrease of the remainder across the lane in a step [m]."""
TURN = 0.012
"""Decrease of the heading's remainder in a step [rad]."""


class FadingPoses:
    """The remainders of one simulation's vehicles.

    Args:
        world: The world; vehicles' motion is written.
        row: The simulation.
    """

    def __init__(self, world: World, row: int) -> None:
        capacity = world.vehicles.capacity
        self._left, self._is_new = np.zeros((capacity, 3)), np.zeros(capacity, np.bool_)
        self._slots: list[int] = []
        states, last, sumo = world.vehicles.of(row), np.zeros((capacity, 6)), np.zeros((capacity, 4))
        self._keep = bind(keep_motion, states, last)
        self._fade = bind(fade, states, last, sumo, self._left, self._is_new, world.dt)

    def clear(self) -> None:
        """Forget all remainders."""
        self._slots.clear()

    def begin(self, slot: int) -> None:
        """Let a vehicle that SUMO drives from this step on begin with the motion that it has now."""
        self._is_new[slot] = True
        self._slots.append(slot)
        self._keep(slot)

    def drop(self, slot: int) -> None:
        """Forget the remainder of a vehicle, if there is one."""
        if slot in self._slots:
            self._slots.remove(slot)

    def apply(self, off_centre: Container[int]) -> None:
        """Add the remainders to the poses of the step, which are SUMO's.

        Args:
            off_centre: Slots of vehicles that SUMO may not have on their centrelines yet.
        """
        if self._slots:
            self._fade(np.array(self._slots, np.intp))
            self._slots = [slot for slot in self._slots if slot in off_centre or self._left[slot].any()]


@kernel
def keep_motion(states: VehicleStates, last: Floats, slot: int) -> None:
    """Write a vehicle's x, y, heading, speed, lateral speed and yaw rate into its row of `last`, (V, 6)."""
    last[slot, 0], last[slot, 1] = states.position[slot, 0], states.position[slot, 1]
    last[slot, 2], last[slot, 3] = states.heading[slot], states.speed[slot]
    last[slot, 4], last[slot, 5] = states.lateral_speed[slot], states.yaw_rate[slot]


@kernel
def fade(
    states: VehicleStates,
    last: Floats,
    sumo: Floats,
    left: Floats,
    is_new: Bools,
    dt: float,
    slots: NDArray[np.intp],
) -> None:
    """Shrink remainders, and add them to vehicles' poses.

    Args:
        states: Vehicles of one simulation with SUMO's poses; their motion is written.
        last: Their motion one step ago, see `keep_motion`; written.
        sumo: SUMO's x, y and heading one step ago, and how far to the left of its course the vehicle went in
            that step, shape (V, 4); written.
        left: Remainders along and across the lane, to the left [m], and of the heading [rad], shape (V, 3);
            written.
        is_new: Which remainders are what is left of a steady motion since the step before, shape (V,);
            cleared.
        dt: Duration of the step [s].
        slots: The vehicles, shape (N,).
    """
    for slot in slots:
        x0, y0, heading0, speed0, sideways0, yaw_rate0 = last[slot]
        heading = states.heading[slot]
        cos, sin = math.cos(heading), math.sin(heading)
        if is_new[slot]:
            turn = dt * yaw_rate0
            course = heading0 + 0.5 * turn
            ahead, aside = 0.5 * dt * (speed0 + states.speed[slot]), dt * sideways0
            dx = x0 + ahead * math.cos(course) - aside * math.sin(course) - states.position[slot, 0]
            dy = y0 + ahead * math.sin(course) + aside * math.cos(course) - states.position[slot, 1]
            left[slot, 0], left[slot, 1] = dx * cos + dy * sin, dy * cos - dx * sin
            left[slot, 2] = wrapped(heading0 + turn - heading)
            is_new[slot] = False
            sumo[slot, 3] = aside
        else:
            jump = _across(states, sumo[slot], slot) - sumo[slot, 3]
            if abs(jump) > ASIDE:
                left[slot, 1] -= jump
            else:
                sumo[slot, 3] += jump
        sumo[slot, 0], sumo[slot, 1], sumo[slot, 2] = (
            states.position[slot, 0],
            states.position[slot, 1],
            heading,
        )
        for column, step in ((0, ALONG), (1, ASIDE), (2, TURN)):
            size = max(abs(left[slot, column]) - step, 0.0)
            left[slot, column] = math.copysign(size, left[slot, column]) if size > 0.0 else 0.0
        states.position[slot, 0] += left[slot, 0] * cos - left[slot, 1] * sin
        states.position[slot, 1] += left[slot, 0] * sin + left[slot, 1] * cos
        states.heading[slot] = wrapped(heading + left[slot, 2])
        # The motion is that of the poses, as `fill_rows` has it.
        turn = wrapped(states.heading[slot] - heading0)
        mean = states.heading[slot] - 0.5 * turn
        dx, dy = states.position[slot, 0] - x0, states.position[slot, 1] - y0
        states.yaw_rate[slot] = turn / dt
        states.lateral_speed[slot] = (dy * math.cos(mean) - dx * math.sin(mean)) / dt
        states.lateral_acceleration[slot] = states.speed[slot] * states.yaw_rate[slot]
        states.yaw_acceleration[slot] = (states.yaw_rate[slot] - yaw_rate0) / dt
        keep_motion(states, last, slot)


@kernel
def _across(states: VehicleStates, before: Floats, slot: int) -> float:
    """Return how far to the left of its mean heading a vehicle has gone since x, y, heading `before` [m]."""
    mean = before[2] + 0.5 * wrapped(states.heading[slot] - before[2])
    dx, dy = states.position[slot, 0] - before[0], states.position[slot, 1] - before[1]
    return dy * math.cos(mean) - dx * math.sin(mean)
