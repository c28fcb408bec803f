"""What SUMO says of its vehicles, as rows of the world."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from smarts.geometry.compiling import kernel

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]


def centre_of(front: Floats, heading: Floats, length: Floats) -> Floats:
    """Return the centres of footprints, shape (A, 2), of which SUMO names the middle of the front bumper."""
    return front - np.stack([np.cos(heading), np.sin(heading)], -1) * (length[:, None] / 2)


@kernel
def fill_rows(
    rows: NDArray[np.intp],
    front: Floats,
    heading: Floats,
    motion: Floats,
    lane: Ints,
    metres_per_sumo_metre: Floats,
    columns: tuple[Floats, Floats, Floats, Floats, Floats, Floats, Ints],
) -> NDArray[np.bool_]:
    """Fill the rows of A vehicles and return which of them have changed lanes, shape (A,).

    One pass, because at this size a dozen array operations cost more than SUMO's own step.

    Args:
        rows: Where to write, shape (A,).
        front: Middle of the front bumper [m], shape (A, 2).
        heading: [rad], shape (A,).
        motion: Speed, acceleration, SUMO's position of the front along the lane, shape (3, A).
        lane: -1 for none, shape (A,).
        metres_per_sumo_metre: Of each lane, shape (L,).
        columns: `length` to read and, to write, `position`, `heading`, `speed`, `acceleration`,
            `lane_position` and `lane` of the world.
    """
    lengths, positions, headings, speeds, accelerations, lane_positions, lanes = columns
    has_changed = np.empty(len(rows), np.bool_)
    for index in range(len(rows)):
        row = rows[index]
        half = lengths[row] / 2
        positions[row, 0] = front[index, 0] - math.cos(heading[index]) * half
        positions[row, 1] = front[index, 1] - math.sin(heading[index]) * half
        headings[row] = heading[index]
        speeds[row] = motion[0, index]
        accelerations[row] = motion[1, index]
        number = lane[index]
        lane_positions[row] = motion[2, index] * metres_per_sumo_metre[number] - half if number >= 0 else 0.0
        has_changed[index] = lanes[row] != number
        lanes[row] = number
    return has_changed
