"""Kernels that convert between SUMO's values and rows of the world."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools, Floats, Ints
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
    for index in range(len(rows)):
        motion = _motion(values, index, len(rows), states.length[rows[index]])
        _write(states, is_new, dt, rows[index], motion)


@kernel
def _motion(
    values: Floats, index: int, count: int, length: float
) -> tuple[float, float, float, float, float, float]:
    """Return centre x, y [m], heading [rad], speed, acceleration and allowed speed of a vehicle."""
    # Equals `frames.heading_from_compass`.
    heading = wrapped_half_open((90.0 - values[2 * count + index]) * (math.pi / 180.0))
    x = values[2 * index] - math.cos(heading) * (length / 2)
    y = values[2 * index + 1] - math.sin(heading) * (length / 2)
    return x, y, heading, values[3 * count + index], values[4 * count + index], values[5 * count + index]


@kernel
def _write(
    states: VehicleStates,
    is_new: Bools,
    dt: float,
    row: int,
    motion: tuple[float, float, float, float, float, float],
) -> None:
    """Write a vehicle's row; rates are those since the pose that it holds, 0 if `is_new`."""
    position = states.position
    x, y, heading, speed, acceleration, desired_speed = motion
    yaw_rate, sideways, yaw_acceleration = 0.0, 0.0, 0.0
    if not is_new[row]:
        turn = wrapped(heading - states.heading[row])
        mean = heading - 0.5 * turn
        dx, dy = x - position[row, 0], y - position[row, 1]
        yaw_rate, sideways = turn / dt, (dy * math.cos(mean) - dx * math.sin(mean)) / dt
        yaw_acceleration = (yaw_rate - states.yaw_rate[row]) / dt
    is_new[row] = False
    position[row, 0], position[row, 1], states.heading[row] = x, y, heading
    states.speed[row], states.lateral_speed[row] = speed, sideways
    states.acceleration[row] = acceleration
    states.lateral_acceleration[row] = speed * yaw_rate
    states.yaw_rate[row], states.yaw_acceleration[row] = yaw_rate, yaw_acceleration
    states.desired_speed[row] = desired_speed


class Legs(NamedTuple):
    """Poses and speeds of one simulation's V vehicles at the begin and the end of a step of SUMO."""

    generation: Ints
    """Generation of the vehicle in each slot that SUMO drives in this step, else -1, shape (V,)."""
    begin: Floats
    """Centre x, y [m], heading [rad], speed, acceleration, allowed speed [m/s, m/s^2, m/s]; shape (V, 6)."""
    end: Floats
    """The same at the step's end, shape (V, 6)."""

    @classmethod
    def allocate(cls, capacity: int) -> Legs:
        """Return the legs of no vehicle."""
        return cls(np.full(capacity, -1, np.int32), np.zeros((capacity, 6)), np.zeros((capacity, 6)))


@kernel
def begin_legs(
    states: VehicleStates, is_new: Bools, legs: Legs, rows: NDArray[np.intp], values: Floats
) -> None:
    """Begin the next step of SUMO's vehicles, where their last one ended; `rows` and `values` as `fill_rows`.

    Vehicles that another provider has moved begin at their poses. New vehicles stand where they end, until
    this step is over.
    """
    for index in range(len(rows)):
        row = rows[index]
        motion = _motion(values, index, len(rows), states.length[row])
        legs.begin[row] = legs.end[row]
        if legs.generation[row] != states.generation[row]:
            legs.begin[row, :2] = states.position[row]
            legs.begin[row, 2], legs.begin[row, 3] = states.heading[row], states.speed[row]
        for column in range(6):
            legs.end[row, column] = motion[column]
        if is_new[row]:
            legs.begin[row] = legs.end[row]
    legs.generation[:] = -1
    for row in rows:
        legs.generation[row] = states.generation[row]


@kernel
def fill_between(
    states: VehicleStates, is_new: Bools, legs: Legs, dt: float, owner: int, share: float
) -> None:
    """Write the rows of SUMO's vehicles at a share of SUMO's step, in (0, 1]; see `pose_between`.

    Vehicles that another provider has taken or dismissed since SUMO's step are left out.
    """
    for row in range(len(legs.generation)):
        if states.owner[row] == owner and legs.generation[row] == states.generation[row]:
            _write(states, is_new, dt, row, pose_between(legs.begin[row], legs.end[row], share))


@kernel
def pose_between(begin: Floats, end: Floats, share: float) -> tuple[float, float, float, float, float, float]:
    """Return a vehicle's motion at a share of the time between two, in the columns of `Legs`.

    The speed changes evenly. The path is a cubic curve that leaves and arrives along the two headings.
    """
    if share >= 1.0:
        return end[0], end[1], end[2], end[3], end[4], end[5]
    speed = begin[3] + (end[3] - begin[3]) * share
    total = begin[3] + end[3]
    # The share of the way: of the area under the speed.
    along = share * (begin[3] + speed) / total if total > 0.0 else share
    chord = math.hypot(end[0] - begin[0], end[1] - begin[1])
    rest = 1.0 - along
    leaving, arriving = along * rest * rest * chord, -along * along * rest * chord
    arrived = along * along * (3.0 - 2.0 * along)
    x = begin[0] + (end[0] - begin[0]) * arrived
    y = begin[1] + (end[1] - begin[1]) * arrived
    x += leaving * math.cos(begin[2]) + arriving * math.cos(end[2])
    y += leaving * math.sin(begin[2]) + arriving * math.sin(end[2])
    heading = wrapped_half_open(begin[2] + along * wrapped(end[2] - begin[2]))
    return x, y, heading, speed, end[4], end[5]


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
def lead(states: VehicleStates, rows: NDArray[np.intp], ahead: float) -> Floats:
    """Return the poses of A vehicles of other providers as SUMO needs them, shape (A, `LEADING`).

    Args:
        states: Vehicles of one simulation.
        rows: Rows of the A vehicles, shape (A,).
        ahead: Time for which they are assumed to keep speed and yaw rate from now on [s].

    Returns:
        x, y of the middle of the front bumper [m], SUMO's angle [degrees], heading [rad], speed [m/s], length
        and width [m].
    """
    found = np.empty((len(rows), LEADING))
    for index in range(len(rows)):
        row = rows[index]
        turn, half = states.heading[row], states.length[row] / 2
        x, y = states.position[row, 0], states.position[row, 1]
        if ahead > 0.0:
            mean, way = turn + 0.5 * ahead * states.yaw_rate[row], ahead * states.speed[row]
            x, y = x + way * math.cos(mean), y + way * math.sin(mean)
            turn = wrapped_half_open(turn + ahead * states.yaw_rate[row])
        found[index, 0] = x + half * math.cos(turn)
        found[index, 1] = y + half * math.sin(turn)
        # Equals `frames.compass_from_heading`.
        found[index, 2] = (90.0 - turn * (180.0 / math.pi)) % 360.0
        found[index, 3], found[index, 4] = turn, states.speed[row]
        found[index, 5], found[index, 6] = states.length[row], states.width[row]
    return found
