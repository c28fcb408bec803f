"""Kernels at the edges of a step: controls in, the vehicles' motion out."""

from __future__ import annotations

import math

from smarts.arrays import Bools, Floats, Longs
from smarts.dynamics.layout import FleetArrays
from smarts.dynamics.motion import Motion
from smarts.dynamics.single_track import overhang, planar_motion, record_pose
from smarts.geometry.compiling import kernel


@kernel
def take_controls(fleet: FleetArrays, moving: Bools, given: Floats) -> None:
    """Clip `given` controls, shape (E, 3), into the fleet's.

    Throttle and steering are clipped to [-1, 1], brake to [0, 1]. Only rows of `moving`, shape (E,), are
    written.
    """
    for row in range(moving.size):
        if not moving[row]:
            continue
        for column in range(3):
            least = 0.0 if column == 1 else -1.0
            fleet.controls[row, column] = min(max(given[row, column], least), 1.0)


@kernel
def remember_velocity(fleet: FleetArrays) -> None:
    """Copy the bodies' velocities to `before`."""
    for row in range(fleet.bodies.shape[0]):
        fleet.before[row, 0] = fleet.bodies[row, 7]
        fleet.before[row, 1] = fleet.bodies[row, 8]


@kernel
def record_poses(fleet: FleetArrays, rows: Longs, substep: int) -> None:
    """Write the poses of `rows`, shape (R,), after a sub-step."""
    for row in rows:
        record_pose(fleet.cars[row], fleet.bodies[row], fleet.poses[row, substep])


@kernel
def show_wheels(fleet: FleetArrays) -> None:
    """Write where the vehicles' wheels stand, from the last of `poses`."""
    for row in range(fleet.active.size):
        if not fleet.active[row]:
            continue
        car, pose = fleet.cars[row], fleet.poses[row, -1]
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        for wheel in range(fleet.wheel_position.shape[1]):
            x, y = car.centre_to_cog + car.wheel_x[wheel], car.wheel_y[wheel]
            fleet.wheel_position[row, wheel, 0] = pose[0] + x * cos - y * sin
            fleet.wheel_position[row, wheel, 1] = pose[1] + x * sin + y * cos


@kernel
def show_motion(fleet: FleetArrays, motion: Motion, moving: Bools) -> int:
    """Write the planar motion of the moving vehicles; return the first row that is lost, or -1.

    Args:
        fleet: The fleet; `lost` is set where the motion is not finite.
        motion: Written: velocity, yaw rate, acceleration, overhang.
        moving: Rows that have made the step, shape (E,).
    """
    first, velocity = -1, motion.velocity
    for row in range(moving.size):
        if not moving[row]:
            continue
        body = fleet.bodies[row]
        heading, velocity[row, 0], velocity[row, 1], motion.yaw_rate[row] = planar_motion(body)
        cos, sin = math.cos(heading), math.sin(heading)
        ax = (body[7] - fleet.before[row, 0]) / fleet.step
        ay = (body[8] - fleet.before[row, 1]) / fleet.step
        motion.acceleration[row, 0] = ax * cos + ay * sin
        motion.acceleration[row, 1] = ay * cos - ax * sin
        motion.overhang[row] = overhang(fleet.cars[row], body)
        if not math.isfinite(
            body[0] + body[1] + body[2] + velocity[row, 0] + velocity[row, 1] + motion.yaw_rate[row]
        ):
            fleet.lost[row] = True
        if fleet.lost[row] and first < 0:
            first = row
    return first
