"""What SUMO says of its vehicles, as rows of the world."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from smarts.geometry.compiling import kernel

Floats = NDArray[np.float64]


def centre_of(front: Floats, heading: Floats, length: Floats) -> Floats:
    """Return the centres of footprints, shape (A, 2), of which SUMO names the middle of the front bumper."""
    return front - np.stack([np.cos(heading), np.sin(heading)], -1) * (length[:, None] / 2)


@kernel
def fill_rows(
    rows: NDArray[np.intp],
    values: Floats,
    length: Floats,
    position: Floats,
    heading: Floats,
    speed: Floats,
    acceleration: Floats,
    desired_speed: Floats,
) -> None:
    """Fill the rows of A vehicles.

    One pass, because at this size a dozen array operations cost more than SUMO's own step.

    Args:
        rows: Where to write, shape (A,).
        values: Shape (6 A,): x and y of the middle of the front bumper of every vehicle [m], then all
            headings [rad], speeds [m/s], accelerations [m/s^2] and allowed speeds [m/s].
        length: Column of the world, read, shape (V,) as the others.
        position: Column of the world, shape (V, 2).
        heading: Column of the world.
        speed: Column of the world.
        acceleration: Column of the world.
        desired_speed: Column of the world.
    """
    count = len(rows)
    for index in range(count):
        row = rows[index]
        half = length[row] / 2
        heading[row] = values[2 * count + index]
        position[row, 0] = values[2 * index] - math.cos(heading[row]) * half
        position[row, 1] = values[2 * index + 1] - math.sin(heading[row]) * half
        speed[row] = values[3 * count + index]
        acceleration[row] = values[4 * count + index]
        desired_speed[row] = values[5 * count + index]
