"""What SUMO says of its vehicles, as rows of the world."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smarts.geometry.compiling import kernel
from smarts.geometry.segments import wrapped

Floats = NDArray[np.float64]


def centre_of(front: Floats, heading: Floats, length: Floats) -> Floats:
    """Return the centres of footprints, shape (A, 2), of which SUMO names the middle of the front bumper."""
    return front - np.stack([np.cos(heading), np.sin(heading)], -1) * (length[:, None] / 2)


class MotionColumns(NamedTuple):
    """Columns of the world that tell how vehicles move, shape (V,), `position` (V, 2)."""

    position: Floats
    heading: Floats
    speed: Floats
    lateral_speed: Floats
    acceleration: Floats
    lateral_acceleration: Floats
    yaw_rate: Floats
    yaw_acceleration: Floats
    desired_speed: Floats


@kernel
def fill_rows(
    rows: NDArray[np.intp],
    values: Floats,
    length: Floats,
    is_new: NDArray[np.bool_],
    dt: float,
    columns: MotionColumns,
) -> None:
    """Fill the rows of A vehicles.

    SUMO says nothing of turning and of moving sideways; both follow from the poses a step ago, which the rows
    still hold, and are 0 for those who have just come in. One pass, because at this size a dozen array
    operations cost more than SUMO's own step.

    Args:
        rows: Where to write, shape (A,).
        values: Shape (6 A,): x and y of the middle of the front bumper of every vehicle [m], then all
            headings [rad], speeds [m/s], accelerations [m/s^2] and allowed speeds [m/s].
        length: Column of the world, read, shape (V,).
        is_new: Whether the row does not hold the vehicle's pose a step ago, shape (V,); cleared.
        dt: Step [s].
        columns: Written.
    """
    position, before = columns.position, columns.heading
    count = len(rows)
    for index in range(count):
        row = rows[index]
        half, heading = length[row] / 2, values[2 * count + index]
        x = values[2 * index] - math.cos(heading) * half
        y = values[2 * index + 1] - math.sin(heading) * half
        speed, yaw_rate, sideways, yaw_acceleration = values[3 * count + index], 0.0, 0.0, 0.0
        if not is_new[row]:
            turn = wrapped(heading - before[row])
            mean = heading - 0.5 * turn
            dx, dy = x - position[row, 0], y - position[row, 1]
            yaw_rate, sideways = turn / dt, (dy * math.cos(mean) - dx * math.sin(mean)) / dt
            yaw_acceleration = (yaw_rate - columns.yaw_rate[row]) / dt
        is_new[row] = False
        position[row, 0], position[row, 1], columns.heading[row] = x, y, heading
        columns.speed[row], columns.lateral_speed[row] = speed, sideways
        columns.acceleration[row] = values[4 * count + index]
        columns.lateral_acceleration[row] = speed * yaw_rate
        columns.yaw_rate[row], columns.yaw_acceleration[row] = yaw_rate, yaw_acceleration
        columns.desired_speed[row] = values[5 * count + index]
