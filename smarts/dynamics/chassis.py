"""Forces on a car's body over one sub-step: from motion and controls to new velocities.

Bullet moves the body; all forces on it are computed here: suspension, tyres, drag, gravity, and the road
against the shell of a car that lies on its side. Forces act at the wheels' contacts, so load transfer needs
no model of its own. Wheels have no mass but for their spin.
"""

from __future__ import annotations

import math

from smarts.arrays import Longs
from smarts.dynamics.layout import GRAVITY, WHEELS, FleetArrays
from smarts.dynamics.wheel import roll
from smarts.geometry.compiling import kernel

MAX_LOAD = 6.0
"""Largest load of a wheel over its static load; a harder blow bottoms out on the shell."""
LEAST_UPRIGHT = 0.5
"""Cosine of the angle beyond which a tipped car's wheels no longer carry it."""
SHELL_SINK = 0.05
"""How deep a car resting on four corners of its shell sinks into the road [m]."""
SHELL_FRICTION = 0.6
"""Friction of sheet metal on asphalt."""


@kernel
def advance(fleet: FleetArrays, rows: Longs) -> None:
    """Write states and `velocities` of the vehicles of `rows`, shape (R,), after one sub-step's forces.

    Bullet accepts finite velocities only: a body with others is stopped, and its row marked as lost.
    """
    for row in rows:
        advance_one(fleet, row)


@kernel
def advance_one(fleet: FleetArrays, row: int) -> None:
    """Write state and velocity of one vehicle; see `advance`."""
    given = fleet.cars[row], fleet.states[row], fleet.bodies[row], fleet.controls[row], fleet.road[row]
    if not _advance(*given, fleet.velocities[row], fleet.dt):
        fleet.lost[row] = True


@kernel
def _advance(car, state, body, controls, road, velocity, dt):
    """Write a vehicle's state and velocity, shape (2, 3), after one sub-step; return whether it is finite."""
    axes = rotation(body)
    left, right = steer(car, state, controls[2], dt)
    fx = fy = fz = tx = ty = tz = 0.0
    compressions = _compressions(car, state, body, axes, road)
    for wheel in range(WHEELS):
        angle = (left if wheel == 0 else right) if wheel < 2 else 0.0
        force, arm = _wheel_force(car, state, body, axes, road, controls, wheel, angle, compressions, dt)
        moment = _cross(arm, force)
        fx, fy, fz = fx + force[0], fy + force[1], fz + force[2]
        tx, ty, tz = tx + moment[0], ty + moment[1], tz + moment[2]
    force, torque = _shell_on_road(car, body, axes, road, dt)
    vx, vy, vz = body[7], body[8], body[9]
    drag = -car.drag * math.sqrt(vx * vx + vy * vy + vz * vz)
    velocity[0, 0] = vx + dt * (fx + force[0] + drag * vx) / car.mass
    velocity[0, 1] = vy + dt * (fy + force[1] + drag * vy) / car.mass
    velocity[0, 2] = vz + dt * ((fz + force[2] + drag * vz) / car.mass - GRAVITY)
    turn = _angular_acceleration(car, axes, tx + torque[0], ty + torque[1], tz + torque[2])
    for axis in range(3):
        velocity[1, axis] = body[10 + axis] + dt * turn[axis]
    if math.isfinite(_dot(velocity[0], velocity[0]) + _dot(velocity[1], velocity[1])):
        return True
    velocity[:] = 0.0
    return False


@kernel
def rotation(body):
    """Return the body's axes forward, left, up in the world, three triples."""
    x, y, z, w = body[3], body[4], body[5], body[6]
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)),
        (2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + x * w)),
        (2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)),
    )


@kernel
def turn_wheels(car, state, command, dt):
    """Turn the steering towards `command` in [-1, 1] (left)."""
    target = command * car.max_steering
    reach = car.steering_rate * dt
    state.steering = min(max(target, state.steering - reach), state.steering + reach)


@kernel
def steer(car, state, command, dt):
    """Turn the steering towards `command` in [-1, 1] (left), return both front wheels' angles [rad].

    The angles are Ackermann's: both wheels' axles meet on the rear axle's line.
    """
    turn_wheels(car, state, command, dt)
    tangent = math.tan(state.steering)
    wheelbase = car.cog_to_front_axle + car.cog_to_rear_axle
    left = math.atan(tangent / (1.0 - tangent * car.wheel_y[0] / wheelbase))
    right = math.atan(tangent / (1.0 - tangent * car.wheel_y[1] / wheelbase))
    return left, right


@kernel
def _dot(a, b):
    """Return the scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def _cross(a, b):
    """Return the vector product of two vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def _place(axes, x, y, z):
    """Return a point of the body's frame as an arm from the centre of gravity in the world."""
    forward, left, up = axes
    return (
        x * forward[0] + y * left[0] + z * up[0],
        x * forward[1] + y * left[1] + z * up[1],
        x * forward[2] + y * left[2] + z * up[2],
    )


@kernel
def _height(body, road, arm):
    """Return the height of a point above the road's plane [m]."""
    return (
        road[4] * (body[0] + arm[0]) + road[5] * (body[1] + arm[1]) + road[6] * (body[2] + arm[2]) - road[7]
    )


@kernel
def _point_velocity(body, arm):
    """Return the velocity of a point of the body [m/s]."""
    return (
        body[7] + body[11] * arm[2] - body[12] * arm[1],
        body[8] + body[12] * arm[0] - body[10] * arm[2],
        body[9] + body[10] * arm[1] - body[11] * arm[0],
    )


@kernel
def _compression(car, state, body, axes, road, wheel):
    """Return how far a suspension is compressed [m]; negative in the air."""
    radius = car.radius[wheel]
    arm = _place(axes, car.wheel_x[wheel], car.wheel_y[wheel], radius - car.cog_height)
    at_rest = car.static_load[wheel] / car.spring[wheel]
    return at_rest + radius * state.radius_factor[wheel] - _height(body, road, arm)


@kernel
def _compressions(car, state, body, axes, road):
    """Return the four suspensions' compressions [m]."""
    return (
        _compression(car, state, body, axes, road, 0),
        _compression(car, state, body, axes, road, 1),
        _compression(car, state, body, axes, road, 2),
        _compression(car, state, body, axes, road, 3),
    )


@kernel
def _wheel_force(car, state, body, axes, road, controls, wheel, angle, compressions, dt):
    """Return a wheel's force on the body [N] and the arm from the centre of gravity to its contact [m]."""
    normal = road[4], road[5], road[6]
    hub = _place(axes, car.wheel_x[wheel], car.wheel_y[wheel], car.radius[wheel] - car.cog_height)
    height = _height(body, road, hub)
    arm = hub[0] - height * normal[0], hub[1] - height * normal[1], hub[2] - height * normal[2]
    velocity = _point_velocity(body, arm)
    load = 0.0
    if _dot(normal, axes[2]) > LEAST_UPRIGHT:
        load = _load(car, wheel, compressions[wheel], compressions[wheel ^ 1], -_dot(normal, velocity))
    # The wheel's heading, turned by its steering angle and laid into the road's plane.
    heading = _place(axes, math.cos(angle), math.sin(angle), 0.0)
    lift = _dot(normal, heading)
    hx, hy, hz = heading[0] - lift * normal[0], heading[1] - lift * normal[1], heading[2] - lift * normal[2]
    length = math.sqrt(hx * hx + hy * hy + hz * hz)
    forward = hx / length, hy / length, hz / length
    side = _cross(normal, forward)

    force_x, force_y = roll(
        car,
        state,
        wheel,
        load,
        road[wheel],
        _dot(forward, velocity),
        _dot(side, velocity),
        drive_torque(car, state, wheel, controls[0]),
        brake_torque(car, state, wheel, controls[1], load, road),
        dt,
    )
    state.load[wheel] = load
    state.force_x[wheel] = force_x
    state.force_y[wheel] = force_y
    force = (
        load * normal[0] + force_x * forward[0] + force_y * side[0],
        load * normal[1] + force_x * forward[1] + force_y * side[1],
        load * normal[2] + force_x * forward[2] + force_y * side[2],
    )
    return force, arm


@kernel
def _load(car, wheel, compression, opposite, sinking):
    """Return a wheel's load [N] from its and its opposite's compression [m] and its rate [m/s]."""
    if compression <= 0.0:
        return 0.0
    load = car.spring[wheel] * compression + car.damper[wheel] * sinking
    load += car.roll_spring[wheel] * (compression - max(opposite, 0.0))
    return min(max(load, 0.0), MAX_LOAD * car.static_load[wheel])


@kernel
def drive_torque(car, state, wheel, throttle):
    """Return the engine's torque at a wheel [N m]: limited by force, and by power at speed."""
    if throttle == 0.0 or car.drive_share[wheel] == 0.0:
        return 0.0
    torque = car.drive_force * car.radius[wheel]
    spin = abs(state.spin[wheel])
    if torque * spin > car.drive_power:
        torque = car.drive_power / spin
    return throttle * torque * car.drive_share[wheel]


@kernel
def brake_torque(car, state, wheel, brake, load, road):
    """Return the largest torque of a wheel's brake [N m].

    On the rear axle ABS selects low, as it does in cars: where one side is slippery, the other brakes no
    harder than that side could, which keeps the rear's side force.
    """
    torque = brake * car.brake_torque[wheel]
    if car.abs and wheel >= 2:
        other = road[wheel ^ 1] * state.grip_factor[wheel ^ 1]
        if other < road[wheel] * state.grip_factor[wheel]:
            torque = min(torque, other * load * car.radius[wheel])
    return torque


@kernel
def _angular_acceleration(car, axes, tx, ty, tz):
    """Return what a torque [N m] in the world does to the body's angular velocity [rad/s^2].

    The gyroscopic term is Bullet's part.
    """
    ax = ay = az = 0.0
    for axis in range(3):
        direction = axes[axis]
        rate = _dot((tx, ty, tz), direction) / car.inertia[axis]
        ax, ay, az = ax + rate * direction[0], ay + rate * direction[1], az + rate * direction[2]
    return ax, ay, az


@kernel
def _shell_on_road(car, body, axes, road, dt):
    """Return force [N] and torque [N m] of the road on the corners of the body's box.

    There is no ground plane in Bullet; this is what carries a car that a collision has tipped over.
    """
    fx = fy = fz = tx = ty = tz = 0.0
    height = _height(body, road, (0.0, 0.0, 0.0))
    reach = car.half_size[0] + car.half_size[1] + car.half_size[2] + abs(car.box_height)
    upright = _dot(axes[2], (road[4], road[5], road[6]))
    if (upright > 0.95 and height > 0.5 * car.cog_height) or height > reach:
        return (fx, fy, fz), (tx, ty, tz)
    for corner in range(8):
        arm = _place(
            axes,
            car.half_size[0] * (1.0 if corner & 1 else -1.0) - car.centre_to_cog,
            car.half_size[1] * (1.0 if corner & 2 else -1.0),
            car.half_size[2] * (1.0 if corner & 4 else -1.0) + car.box_height,
        )
        force = _corner_force(car, body, road, arm, dt)
        moment = _cross(arm, force)
        fx, fy, fz = fx + force[0], fy + force[1], fz + force[2]
        tx, ty, tz = tx + moment[0], ty + moment[1], tz + moment[2]
    return (fx, fy, fz), (tx, ty, tz)


@kernel
def _corner_force(car, body, road, arm, dt):
    """Return the road's force on one corner of the shell [N]: a damped spring and Coulomb's friction."""
    depth = -_height(body, road, arm)
    if depth <= 0.0:
        return 0.0, 0.0, 0.0
    nx, ny, nz = road[4], road[5], road[6]
    vx, vy, vz = _point_velocity(body, arm)
    rise = vx * nx + vy * ny + vz * nz
    stiffness = car.mass * GRAVITY / (4.0 * SHELL_SINK)
    load = max(stiffness * depth - 0.4 * math.sqrt(stiffness * car.mass) * rise, 0.0)
    vx, vy, vz = vx - rise * nx, vy - rise * ny, vz - rise * nz
    slide = math.sqrt(vx * vx + vy * vy + vz * vz)
    # Never more than stops this corner's share of the mass within the sub-step.
    friction = min(SHELL_FRICTION * load / max(slide, 1e-6), 0.05 * car.mass / dt)
    return load * nx - friction * vx, load * ny - friction * vy, load * nz - friction * vz
