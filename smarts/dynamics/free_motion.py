"""Kernels that move bodies which touch nothing, as Bullet would.

Most of the time no body is within reach of another. Bullet then only integrates each motion, but through
thirty calls from Python per vehicle and step, two thirds of the time of all vehicles. `find_near` finds the
simulations in which bodies may touch within the step; only these run in Bullet. The other bodies are moved
here by the steps of Bullet's integrator (btMultiBody without links): the gyroscopic term, the velocity, then
with the new velocity position and orientation, the latter by the exponential map. `test_free_motion.py`
compares both.
"""

from __future__ import annotations

import math

from smarts.arrays import Longs
from smarts.dynamics.chassis import advance_one, rotation
from smarts.dynamics.layout import FleetArrays
from smarts.dynamics.single_track import footprint, overhang, record_pose
from smarts.geometry.boxes import may_meet
from smarts.geometry.compiling import kernel

FASTEST = 100.0
"""Bullet's limit to each component of velocity and angular velocity [m/s, rad/s]."""
MOST_TURN = 0.25 * math.pi
"""Bullet's limit to the turn in a sub-step [rad]."""
SLACK = 0.4
"""How much nearer two vehicles may come in a step than their velocities say [m]: 0.12 m if both swerve or
brake at 1.2 g, 0.13 m by a corner at 10 rad/s^2, the rest for Bullet's margins and for what bodies tip over
further in the step."""


@kernel
def advance_free(fleet: FleetArrays, rows: Longs, substep: int) -> None:
    """Advance the bodies of `rows`, shape (R,), which touch nothing, by one sub-step; write their poses."""
    for row in rows:
        advance_one(fleet, row)
        integrate(fleet.cars[row], fleet.bodies[row], fleet.velocities[row], fleet.dt)
        record_pose(fleet.cars[row], fleet.bodies[row], fleet.poses[row, substep])


@kernel
def integrate(car, body, velocity, dt):
    """Move a body on by one sub-step at the linear and angular velocity that it is given, shape (2, 3)."""
    axes = rotation(body)
    wx, wy, wz = velocity[1, 0], velocity[1, 1], velocity[1, 2]
    # Euler's equations, in the body's frame.
    p = wx * axes[0][0] + wy * axes[0][1] + wz * axes[0][2]
    q = wx * axes[1][0] + wy * axes[1][1] + wz * axes[1][2]
    r = wx * axes[2][0] + wy * axes[2][1] + wz * axes[2][2]
    ix, iy, iz = car.inertia[0], car.inertia[1], car.inertia[2]
    p_rate, q_rate, r_rate = (iy - iz) * q * r / ix, (iz - ix) * r * p / iy, (ix - iy) * p * q / iz
    for axis in range(3):
        turn = p_rate * axes[0][axis] + q_rate * axes[1][axis] + r_rate * axes[2][axis]
        body[7 + axis] = min(max(velocity[0, axis], -FASTEST), FASTEST)
        body[10 + axis] = min(max(velocity[1, axis] + dt * turn, -FASTEST), FASTEST)
        body[axis] += dt * body[7 + axis]
    _turn(body, dt)


@kernel
def _turn(body, dt):
    """Turn a body on by one sub-step at its angular velocity."""
    wx, wy, wz = body[10], body[11], body[12]
    rate = math.sqrt(wx * wx + wy * wy + wz * wz)
    if rate < 0.001:
        share = 0.5 * dt - dt * dt * dt / 48.0 * rate * rate
    else:
        rate = min(rate, MOST_TURN / dt)
        share = math.sin(0.5 * rate * dt) / rate
    ax, ay, az, aw = share * wx, share * wy, share * wz, math.cos(0.5 * rate * dt)
    x, y, z, w = body[3], body[4], body[5], body[6]
    qx = aw * x + ax * w + ay * z - az * y
    qy = aw * y + ay * w + az * x - ax * z
    qz = aw * z + az * w + ax * y - ay * x
    qw = aw * w - ax * x - ay * y - az * z
    length = math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
    body[3], body[4], body[5], body[6] = qx / length, qy / length, qz / length, qw / length


@kernel
def find_near(cars, bodies, with_boxes, step, near, rows):
    """Mark the simulations in which a body in Bullet may touch another within a step.

    Args:
        cars: Parameters, shape (E,), dtype `layout.PARAMETERS`.
        bodies: Shape (E, 13), see `layout.BODY_SIZE`.
        with_boxes: Simulations that hold boxes, shape (B,).
        step: [s].
        near: Written for the simulations of `rows`, shape (B,).
        rows: Bodies in Bullet that are to move, in ascending order, shape (R,).

    Returns:
        Whether any simulation is marked.
    """
    egos = bodies.shape[0] // near.shape[0]
    found = False
    for number in range(rows.size):
        row = rows[number]
        b = row // egos
        if number == 0 or rows[number - 1] // egos != b:
            near[b] = with_boxes[b]
        behind = number - 1
        while behind >= 0 and not near[b] and rows[behind] // egos == b:
            other = rows[behind]
            one, two = _mover(cars[row], bodies[row]), _mover(cars[other], bodies[other])
            slack = SLACK + overhang(cars[row], bodies[row]) + overhang(cars[other], bodies[other])
            near[b] = may_meet(one, two, step, slack)
            behind -= 1
        found = found or near[b]
    return found


@kernel
def _mover(car, body):
    """Return the moving footprint of a body, a `geometry.boxes.Mover`."""
    return footprint(car, body), car.half_size[0], car.half_size[1], body[7], body[8], body[12]
