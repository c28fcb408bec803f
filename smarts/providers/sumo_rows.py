"""SUMO's vehicles as rows of the world."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools, Floats
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import wrapped, wrapped_half_open
from smarts.types.vehicles import VehicleStates


def centre_of(front: Floats, heading: Floats, length: Floats) -> Floats:
    """Return the centres of footprints, shape (A, 2), of which SUMO names the middle of the front bumper."""
    return front - np.stack([np.cos(heading), np.sin(heading)], -1) * (length[:, None] / 2)


@kernel
def fill_rows(
    states: VehicleStates, is_new: Bools, dt: float, rows: NDArray[np.intp], values: Floats
) -> None:
    """Fill the rows of A vehicles.

    SUMO gives neither yaw rate nor lateral speed; both follow from the poses a step ago, which the rows
    still hold, and are 0 for arrivals. One pass, because at this size a dozen array
    operations cost more than SUMO's own step.

    Args:
        states: Of one simulation, shape (V,); motion and desired speed are written.
        is_new: Whether the row does not hold the vehicle's pose a step ago, shape (V,); cleared.
        dt: Step [s].
        rows: Where to write, shape (A,).
        values: Shape (6 A,): x and y of the middle of the front bumper of every vehicle [m], then all of
            SUMO's angles [degrees], speeds [m/s], accelerations [m/s^2] and allowed speeds [m/s].
    """
    position, before = states.position, states.heading
    count = len(rows)
    for index in range(count):
        row = rows[index]
        half = states.length[row] / 2
        # As `frames.heading_from_compass` has it.
        heading = wrapped_half_open((90.0 - values[2 * count + index]) * (math.pi / 180.0))
        x = values[2 * index] - math.cos(heading) * half
        y = values[2 * index + 1] - math.sin(heading) * half
        speed, yaw_rate, sideways, yaw_acceleration = values[3 * count + index], 0.0, 0.0, 0.0
        if not is_new[row]:
            turn = wrapped(heading - before[row])
            mean = heading - 0.5 * turn
            dx, dy = x - position[row, 0], y - position[row, 1]
            yaw_rate, sideways = turn / dt, (dy * math.cos(mean) - dx * math.sin(mean)) / dt
            yaw_acceleration = (yaw_rate - states.yaw_rate[row]) / dt
        is_new[row] = False
        position[row, 0], position[row, 1], states.heading[row] = x, y, heading
        states.speed[row], states.lateral_speed[row] = speed, sideways
        states.acceleration[row] = values[4 * count + index]
        states.lateral_acceleration[row] = speed * yaw_rate
        states.yaw_rate[row], states.yaw_acceleration[row] = yaw_rate, yaw_acceleration
        states.desired_speed[row] = values[5 * count + index]


@kernel
def next_unplanned(states: VehicleStates, provider: int, begin: int) -> int:
    """Return the first slot from `begin` on whose vehicle a provider drives without a route, or -1."""
    for slot in range(begin, len(states.owner)):
        if states.owner[slot] == provider and states.route[slot] < 0:
            return slot
    return -1


LEADING = 7
"""Numbers that `lead` returns of a vehicle."""


@kernel
def lead(states: VehicleStates, rows: NDArray[np.intp]) -> Floats:
    """Return the poses of A vehicles of other providers in SUMO's terms, shape (A, `LEADING`).

    Args:
        states: Of one simulation.
        rows: Of these vehicles, shape (A,).

    Returns:
        x and y of the middle of the front bumper [m], SUMO's angle [degrees], then heading, speed, length and
        width as they are.
    """
    found = np.empty((len(rows), LEADING))
    for index in range(len(rows)):
        row = rows[index]
        turn, half = states.heading[row], states.length[row] / 2
        found[index, 0] = states.position[row, 0] + half * math.cos(turn)
        found[index, 1] = states.position[row, 1] + half * math.sin(turn)
        # As `frames.compass_from_heading` has it.
        found[index, 2] = (90.0 - turn * (180.0 / math.pi)) % 360.0
        found[index, 3], found[index, 4] = turn, states.speed[row]
        found[index, 5], found[index, 6] = states.length[row], states.width[row]
    return found
