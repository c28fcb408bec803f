"""Oriented boxes: the footprints of vehicles."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from smarts.arrays import Bools, Floats
from smarts.geometry.compiling import kernel

Pose = tuple[float, float, float]
"""x, y of the centre [m], heading [rad]."""
Gaps = tuple[float, float, float, float]
"""The result of `box_gaps` [m]."""
Mover = tuple[Pose, float, float, float, float, float]
"""A moving box: pose, half length, half width [m], velocity in x and y [m/s], yaw rate [rad/s]."""


def boxes_overlap(
    centre: ArrayLike,
    heading: ArrayLike,
    size: ArrayLike,
    centre2: ArrayLike,
    heading2: ArrayLike,
    size2: ArrayLike,
) -> Bools:
    """Return whether two oriented boxes share area, by the separating-axis theorem, shape (...).

    Boxes that only touch do not overlap. The shapes of the two boxes' arguments broadcast.

    Args:
        centre: Centre of the first box [m], shape (..., 2).
        heading: Direction of its length [rad], shape (...).
        size: Its length and width [m], shape (..., 2).
        centre2: Centre of the second box.
        heading2: Its heading.
        size2: Its size.
    """
    axes, axes2 = _axes(heading), _axes(heading2)
    half, half2 = np.asarray(size, float) / 2, np.asarray(size2, float) / 2
    apart = np.asarray(centre2, float) - np.asarray(centre, float)
    # cosines[..., i, j] between axis i of the first box and axis j of the second.
    cosines = np.abs(np.einsum("...ik,...jk->...ij", axes, axes2))
    reach = half + np.einsum("...ij,...j->...i", cosines, half2)
    reach2 = half2 + np.einsum("...ij,...i->...j", cosines, half)
    gap = np.abs(np.einsum("...ik,...k->...i", axes, apart)) - reach
    gap2 = np.abs(np.einsum("...jk,...k->...j", axes2, apart)) - reach2
    return (gap < 0).all(axis=-1) & (gap2 < 0).all(axis=-1)


def _axes(heading: ArrayLike) -> Floats:
    """Return the unit vectors along length and width, shape (..., 2, 2)."""
    cosine, sine = np.cos(heading), np.sin(heading)
    return np.stack([np.stack([cosine, sine], -1), np.stack([-sine, cosine], -1)], -2)


@kernel
def slab(begin: float, direction: float, low: float, high: float) -> tuple[float, float]:
    """Return between which distances a ray is between two walls; the first is larger if never."""
    if direction == 0.0:
        return (-np.inf, np.inf) if low <= begin <= high else (np.inf, -np.inf)
    one, other = (low - begin) / direction, (high - begin) / direction
    return min(one, other), max(one, other)


@kernel
def box_gaps(
    pose: Pose, half_length: float, half_width: float, pose2: Pose, half_length2: float, half_width2: float
) -> Gaps:
    """Return the gaps between two oriented boxes along the four axes that can separate them [m].

    The axes are the directions of length and width of the first box, then of the second. A negative gap is an
    overlap along that axis; the boxes share area if all four gaps are negative.
    """
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    cosine2, sine2 = math.cos(pose2[2]), math.sin(pose2[2])
    dx, dy = pose2[0] - pose[0], pose2[1] - pose[1]
    # Cosines between the two lengths (or the two widths), and between one length and the other width.
    along, across = abs(cosine * cosine2 + sine * sine2), abs(cosine * sine2 - sine * cosine2)
    return (
        abs(dx * cosine + dy * sine) - half_length - along * half_length2 - across * half_width2,
        abs(dy * cosine - dx * sine) - half_width - across * half_length2 - along * half_width2,
        abs(dx * cosine2 + dy * sine2) - half_length2 - along * half_length - across * half_width,
        abs(dy * cosine2 - dx * sine2) - half_width2 - across * half_length - along * half_width,
    )


@kernel
def may_meet(mover: Mover, mover2: Mover, seconds: float, slack: float) -> bool:
    """Return whether two moving boxes may touch within `seconds`; False only if they cannot.

    They cannot touch if the gap along one separating axis is too large to close in that time.

    Args:
        mover: The first box.
        mover2: The second box.
        seconds: The time [s].
        slack: Distance by which the boxes may approach beyond their velocities and yaw rates [m].
    """
    pose, half_length, half_width, vx, vy, yaw_rate = mover
    pose2, half_length2, half_width2, vx2, vy2, yaw_rate2 = mover2
    dx, dy = pose2[0] - pose[0], pose2[1] - pose[1]
    vx, vy = vx2 - vx, vy2 - vy
    corner, corner2 = math.hypot(half_length, half_width), math.hypot(half_length2, half_width2)
    reach = corner + corner2 + slack + seconds * math.hypot(vx, vy)
    if dx * dx + dy * dy > reach * reach:
        return False
    slack += seconds * (corner * abs(yaw_rate) + corner2 * abs(yaw_rate2))
    gaps = box_gaps(pose, half_length, half_width, pose2, half_length2, half_width2)
    for number in range(4):
        heading = pose[2] if number < 2 else pose2[2]
        x, y = math.cos(heading), math.sin(heading)
        if number % 2:
            x, y = -y, x
        closing = -(vx * x + vy * y) if dx * x + dy * y > 0.0 else vx * x + vy * y
        if gaps[number] > slack + seconds * max(closing, 0.0):
            return False
    return True


@kernel
def contact_direction(pose: Pose, pose2: Pose, gaps_before: Gaps, gaps: Gaps) -> tuple[float, float, float]:
    """Return the direction and the time at which two overlapping boxes came into contact.

    The contact direction is the axis whose gap closed last between the previous and the current step. If the
    boxes overlapped in the previous step already, it is the axis along which they overlap least.

    Args:
        pose: Current pose of the first box.
        pose2: Current pose of the second box.
        gaps_before: `box_gaps` of the previous step.
        gaps: Current `box_gaps`, all negative.

    Returns:
        The unit vector from the first box to the second, perpendicular to the sides in contact, and the time
        of contact as a fraction of the step, in [0, 1].
    """
    axis, when = -1, -1.0
    for number in range(4):
        if gaps_before[number] >= 0.0:
            closed = gaps_before[number] / (gaps_before[number] - gaps[number])
            if closed > when:
                axis, when = number, closed
    if axis < 0:
        x, y = facing(pose, pose2, gaps)
        return x, y, 0.0
    x, y = _towards(pose, pose2, axis)
    return x, y, when


@kernel
def facing(pose: Pose, pose2: Pose, gaps: Gaps) -> tuple[float, float]:
    """Return the unit vector from one box to another, along the axis with the largest gap.

    Args:
        pose: Pose of the first box.
        pose2: Pose of the second box.
        gaps: `box_gaps` of the two.
    """
    axis = 0
    for number in range(1, 4):
        if gaps[number] > gaps[axis]:
            axis = number
    return _towards(pose, pose2, axis)


@kernel
def _towards(pose: Pose, pose2: Pose, axis: int) -> tuple[float, float]:
    """Return the unit vector along the axis of `box_gaps[axis]`, from the first box to the second."""
    heading = pose[2] if axis < 2 else pose2[2]
    x, y = math.cos(heading), math.sin(heading)
    if axis % 2:
        x, y = -y, x
    if x * (pose2[0] - pose[0]) + y * (pose2[1] - pose[1]) < 0.0:
        x, y = -x, -y
    return x, y
