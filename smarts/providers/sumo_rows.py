"""Kernels that convert between SUMO's values and rows of the world."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools, Floats
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import wrapped, wrapped_half_open
from smarts.types.vehicles import VehicleStates


def centre_of(front: Floats, heading: Floats, length: Floats) -> Floats:
    """Return the centres of footprints, shape (A, 2), from SUMO's positions of the fronts, (A, 2) [m]."""
    return front - np.stack([np.cos(heading), np.sin(heading)], -1) * (length[:, None] / 2)


@kernel
def fill_rows(
    states: VehicleStates, is_new: Bools, dt: float, rows: NDArray[np.intp], values: Floats
) -> None:
    """Write the rows of A vehicles from SUMO's values.

    SUMO gives no yaw rates and lateral speeds. Both are computed from the poses of the last step, which the
    rows still hold, and are 0 for arrivals. A single pass is faster than a dozen array operations, which at
    this size cost more than SUMO's own step.

    Args:
        states: Vehicles of one simulation, shape (V,); motion and desired speed are written.
        is_new: Whether a row does not hold the vehicle's last pose, shape (V,); cleared.
        dt: Duration of the step [s].
        rows: The rows to write, shape (A,).
        values: Shape (6 A,): x, y of the middle of the front bumper for every vehicle [m], then all of SUMO's
            angles [degrees], speeds [m/s], accelerations [m/s^2] and allowed speeds [m/s].
    """
    position, before = states.position, states.heading
    count = len(rows)
    for index in range(count):
        row = rows[index]
        half = states.length[row] / 2
        # Equals `frames.heading_from_compass`.
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
    """Return the first slot from `begin` on whose vehicle the provider owns and has no route, or -1."""
    for slot in range(begin, len(states.owner)):
        if states.owner[slot] == provider and states.route[slot] < 0:
            return slot
    return -1


LEADING = 7
"""Number of columns of `lead`."""


@kernel
def lead(states: VehicleStates, rows: NDArray[np.intp]) -> Floats:
    """Return the poses of A vehicles of other providers as SUMO needs them, shape (A, `LEADING`).

    Args:
        states: Vehicles of one simulation.
        rows: Rows of the A vehicles, shape (A,).

    Returns:
        x, y of the middle of the front bumper [m], SUMO's angle [degrees], heading [rad], speed [m/s], length
        and width [m].
    """
    found = np.empty((len(rows), LEADING))
    for index in range(len(rows)):
        row = rows[index]
        turn, half = states.heading[row], states.length[row] / 2
        found[index, 0] = states.position[row, 0] + half * math.cos(turn)
        found[index, 1] = states.position[row, 1] + half * math.sin(turn)
        # Equals `frames.compass_from_heading`.
        found[index, 2] = (90.0 - turn * (180.0 / math.pi)) % 360.0
        found[index, 3], found[index, 4] = turn, states.speed[row]
        found[index, 5], found[index, 6] = states.length[row], states.width[row]
    return found
