"""Kernels at the edges of a step: the drivers' controls in, the vehicles' motion out."""

from __future__ import annotations

import math

from smarts.dynamics.single_track import overhang, planar_motion, record_pose
from smarts.geometry.compiling import kernel


@kernel
def take_controls(controls, active, given):
    """Clip `given` controls of shape (E, 3) into `controls`; return the first active row with a NaN, or -1.

    Throttle and steering are clipped to [-1, 1], brake to [0, 1]. Nothing is written for rows that are not
    active.
    """
    for row in range(active.size):
        if not active[row]:
            continue
        for column in range(3):
            value = given[row, column]
            if math.isnan(value):
                return row
            controls[row, column] = min(max(value, 0.0 if column == 1 else -1.0), 1.0)
    return -1


@kernel
def remember_velocity(bodies, before):
    """Copy the bodies' velocities to `before`, shape (E, 2)."""
    for row in range(bodies.shape[0]):
        before[row, 0] = bodies[row, 7]
        before[row, 1] = bodies[row, 8]


@kernel
def record_poses(cars, bodies, poses, rows, substep):
    """Write the footprints' poses of `rows` after a sub-step into `poses`, shape (E, S, 3)."""
    for row in rows:
        record_pose(cars[row], bodies[row], poses[row, substep])


@kernel
def show_wheels(active, cars, poses, positions):
    """Write where the active vehicles' wheels stand [m], shape (E, 4, 2), from the last of `poses`."""
    for row in range(active.size):
        if not active[row]:
            continue
        car, pose = cars[row], poses[row, -1]
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        for wheel in range(positions.shape[1]):
            x, y = car.centre_to_cog + car.wheel_x[wheel], car.wheel_y[wheel]
            positions[row, wheel, 0] = pose[0] + x * cos - y * sin
            positions[row, wheel, 1] = pose[1] + x * sin + y * cos


@kernel
def show_motion(cars, bodies, before, velocity, yaw_rate, acceleration, overhangs, step, lost, active):
    """Write the active vehicles' planar motion; return the first row that is lost, or -1.

    Args:
        cars: Parameters, shape (E,), dtype `layout.PARAMETERS`.
        bodies: Shape (E, 13).
        before: Velocity in the world at the step's beginning [m/s], shape (E, 2).
        velocity: Forward and left [m/s], shape (E, 2); written.
        yaw_rate: [rad/s], shape (E,); written.
        acceleration: Forward and left, the mean over the step [m/s^2], shape (E, 2); written.
        overhangs: As in `Motion` [m], shape (E,); written.
        step: [s].
        lost: Set where the motion is not finite, shape (E,).
        active: Shape (E,).
    """
    first = -1
    for row in range(active.size):
        if not active[row]:
            continue
        body = bodies[row]
        heading, velocity[row, 0], velocity[row, 1], yaw_rate[row] = planar_motion(body)
        cos, sin = math.cos(heading), math.sin(heading)
        ax, ay = (body[7] - before[row, 0]) / step, (body[8] - before[row, 1]) / step
        acceleration[row, 0] = ax * cos + ay * sin
        acceleration[row, 1] = ay * cos - ax * sin
        overhangs[row] = overhang(cars[row], body)
        if not math.isfinite(
            body[0] + body[1] + body[2] + velocity[row, 0] + velocity[row, 1] + yaw_rate[row]
        ):
            lost[row] = True
        if lost[row] and first < 0:
            first = row
    return first
