"""Single-track (bicycle) models: a planar body on one wheel per axle, kinematic or dynamic, without Bullet.

Both models take the same parameters, controls and friction as the car in Bullet and write the same state. The
kinematic model follows its front wheel without slip (Rajamani, Vehicle Dynamics and Control, 2nd ed. 2012,
section 2.2). The dynamic model (section 2.3) slides: lateral forces come from the chosen tyre model through
the same bristle as the car's, load moves between the axles, and braking and driving use up grip. Neither
model has wheel spin (ABS and traction control are implied), sides (a flat tyre slows and weakens its axle but
does not pull), slopes, or contact with other bodies.
"""

from __future__ import annotations

import math

from smarts.arrays import Longs
from smarts.dynamics.chassis import rotation, steer, turn_wheels
from smarts.dynamics.layout import FleetArrays
from smarts.dynamics.tyre_models import characteristics, side_share
from smarts.dynamics.wheel import BREAKAWAY_SPEED, DAMPING_SPEED, DAMPING_TIME, LEAST_FRICTION
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import wrapped_half_open

FRONT, REAR = 0, 2
"""The wheels that stand for their axles."""


@kernel
def advance_kinematic(fleet: FleetArrays, rows: Longs, substep: int) -> None:
    """Advance the kinematic vehicles of `rows`, shape (R,), by one sub-step; write their poses.

    Of the road only the friction at the wheels counts.
    """
    for row in rows:
        car, state, body = fleet.cars[row], fleet.states[row], fleet.bodies[row]
        axles, motion = axles_of(car, state, fleet.road[row]), rolling_motion(car, state, body)
        motion = roll(car, state, axles, motion, fleet.controls[row], fleet.dt)
        stop_rolling(car, state, axles, motion, body)
        record_pose(car, body, fleet.poses[row, substep])


@kernel
def axles_of(car, state, road):
    """Return loads [N] of a front and a rear wheel of a kinematic vehicle, and their largest forces [N]."""
    front, rear = _axle_loads(car, 0.0)
    grip = _axle_tyre(car, state, FRONT, front, road[0:2])[0]
    return front, rear, grip, _axle_tyre(car, state, REAR, rear, road[2:4])[0]


@kernel
def rolling_motion(car, state, body):
    """Return how a kinematic vehicle rolls, for `roll`.

    That is x, y [m] of the rear axle's centre, the heading [rad], its cosine and sine, the speed of the axle
    [m/s], and the tangent of the steering.
    """
    heading, speed, _, _ = planar_motion(body)
    cos, sin = math.cos(heading), math.sin(heading)
    lever = car.cog_to_rear_axle
    return body[0] - lever * cos, body[1] - lever * sin, heading, cos, sin, speed, math.tan(state.steering)


@kernel
def centre_of(car, motion):
    """Return the centre of a rolling vehicle's footprint [m]."""
    ahead = car.cog_to_rear_axle - car.centre_to_cog
    return motion[0] + ahead * motion[3], motion[1] + ahead * motion[4]


@kernel
def roll(car, state, axles, motion, controls, dt):
    """Advance a kinematic vehicle by one sub-step; return its motion.

    The state is the speed v of the rear axle's centre, which is the body's velocity along its heading.
    Neither axle slips sideways, so the yaw rate is v k with the curvature k = tan(steering) / wheelbase, and
    the kinetic energy is M v^2 / 2 with the mass M = m + (m l_r^2 + I_z) k^2. The side forces that hold the
    axles in their tracks act across the wheels' velocities and do no work: turning the steering changes M and
    leaves the energy as it is. Forces along the wheels change v by virtual work; the front wheels roll at
    v / cos(steering). The axle's way is an arc.

    Args:
        car: Parameters.
        state: Its steering is written.
        axles: From `axles_of`.
        motion: From `rolling_motion`.
        controls: Throttle, brake, steering.
        dt: [s].
    """
    x, y, heading, cos, sin, speed, tangent = motion
    load_front, load_rear, grip_front, grip_rear = axles
    wheelbase = car.cog_to_front_axle + car.cog_to_rear_axle
    before = _rolling_mass(car, tangent / wheelbase)
    turn_wheels(car, state, controls[2], dt)
    tangent = math.tan(state.steering)
    curvature, stretch = tangent / wheelbase, math.sqrt(1.0 + tangent * tangent)  # 1 / cos(steering)
    mass = _rolling_mass(car, curvature)
    speed *= math.sqrt(before / mass)
    front = _axle_request(car, state, FRONT, load_front, grip_front, controls, speed * stretch)
    rear = _axle_request(car, state, REAR, load_rear, grip_rear, controls, speed)
    # The centre of gravity is faster than the rear axle, and drag acts there.
    faster = 1.0 + (car.cog_to_rear_axle * curvature) ** 2
    slowing = car.drag * abs(speed) * faster * math.sqrt(faster)
    speed = (speed + dt * (front[0] * stretch + rear[0]) / mass) / (1.0 + dt * slowing / mass)
    speed = _resist(speed, dt * (front[1] * stretch + rear[1]) / mass)
    half = 0.5 * dt * speed * curvature
    c, s = math.cos(half), math.sin(half)
    # The chord of the arc; below 1e-8 its length is that of the arc to the last bit.
    chord = dt * speed * (s / half if abs(half) > 1e-8 else 1.0)
    cos, sin = cos * c - sin * s, sin * c + cos * s
    heading += 2.0 * half
    if abs(heading) >= math.pi:
        heading = wrapped_half_open(heading)
    state.force_x[FRONT], state.force_x[REAR] = 0.5 * _net(front, speed), 0.5 * _net(rear, speed)
    return x + chord * cos, y + chord * sin, heading, cos * c - sin * s, sin * c + cos * s, speed, tangent


@kernel
def stop_rolling(car, state, axles, motion, body):
    """Write a body and the wheels' read-out after sub-steps of `roll`."""
    x, y, heading, _, _, speed, tangent = motion
    lever, cos, sin = car.cog_to_rear_axle, math.cos(heading), math.sin(heading)
    yaw_rate = speed * tangent / (car.cog_to_front_axle + lever)
    body[0], body[1] = x + lever * cos, y + lever * sin
    _set_velocity(body, cos, sin, speed, lever * yaw_rate, yaw_rate)
    _set_heading(body, heading)
    rolling = speed * math.sqrt(1.0 + tangent * tangent)
    _show_axle(car, state, FRONT, axles[0], rolling, 2.0 * state.force_x[FRONT], 0.0)
    _show_axle(car, state, REAR, axles[1], speed, 2.0 * state.force_x[REAR], 0.0)


@kernel
def _rolling_mass(car, curvature):
    """Return the mass [kg] that has a kinematic vehicle's kinetic energy at its rear axle's speed."""
    lever = car.cog_to_rear_axle
    return car.mass + (car.mass * lever * lever + car.inertia[2]) * curvature * curvature


@kernel
def advance_dynamic(fleet: FleetArrays, rows: Longs, substep: int) -> None:
    """Advance dynamic single-track vehicles by one sub-step; see `advance_kinematic`."""
    for row in rows:
        car, body = fleet.cars[row], fleet.bodies[row]
        _advance_dynamic(car, fleet.states[row], body, fleet.controls[row], fleet.road[row], fleet.dt)
        record_pose(car, body, fleet.poses[row, substep])


@kernel
def _advance_dynamic(car, state, body, controls, road, dt):
    """Advance one dynamic single-track vehicle by one sub-step."""
    heading, vx, vy, yaw_rate = planar_motion(body)
    steer(car, state, controls[2], dt)
    cos, sin = math.cos(state.steering), math.sin(state.steering)
    load_front, load_rear = _axle_loads(car, 2.0 * (state.force_x[FRONT] + state.force_x[REAR]))
    tyre_front = _axle_tyre(car, state, FRONT, load_front, road[0:2])
    tyre_rear = _axle_tyre(car, state, REAR, load_rear, road[2:4])
    front_vy, rear_vy = vy + car.cog_to_front_axle * yaw_rate, vy - car.cog_to_rear_axle * yaw_rate
    rolling = vx * cos + front_vy * sin
    front = _axle_request(car, state, FRONT, load_front, tyre_front[0], controls, rolling)
    rear = _axle_request(car, state, REAR, load_rear, tyre_rear[0], controls, vx)
    lever = car.cog_to_front_axle * sin
    front_mass = 1.0 / (1.0 / car.mass + lever * lever / car.inertia[2])
    share = front[1] / max(front[1] + rear[1], 1e-9)
    front_mass, rear_mass = share * front_mass, (1.0 - share) * car.mass
    sliding = front_vy * cos - vx * sin
    front_net = front[0] - _resistance(front[1], front_mass, rolling, dt)
    rear_net = rear[0] - _resistance(rear[1], rear_mass, vx, dt)
    front_y = _axle_side_force(car, state, FRONT, tyre_front, front_net, rolling, sliding, dt)
    rear_y = _axle_side_force(car, state, REAR, tyre_rear, rear_net, vx, rear_vy, dt)

    drag = car.drag * math.sqrt(vx * vx + vy * vy)
    side = front[0] * sin + front_y * cos
    turn = (car.cog_to_front_axle * side - car.cog_to_rear_axle * rear_y) / car.inertia[2]
    vx += dt * (front[0] * cos - front_y * sin + rear[0] - drag * vx) / car.mass
    vy += dt * (side + rear_y - drag * vy) / car.mass
    yaw_rate += dt * turn

    # Resistance acts last, on each axle against its own rolling (in a spin the steered wheels roll the other
    # way than the body), and at most stops its share of what rolls there. The shares add to one, so that
    # both together never add energy: p v + p W p / 2 <= 0 for the impulses p and their mobility W.
    front_loss = _resistance(front[1], front_mass, vx * cos + vy * sin + lever * yaw_rate, dt)
    rear_loss = _resistance(rear[1], rear_mass, vx, dt)
    vx -= dt * (front_loss * cos + rear_loss) / car.mass
    vy -= dt * front_loss * sin / car.mass
    yaw_rate -= dt * front_loss * lever / car.inertia[2]
    _slide(body, heading, vx, vy, yaw_rate, dt)
    rolling = vx * cos + vy * sin + lever * yaw_rate
    _show_axle(car, state, FRONT, load_front, rolling, front[0] - front_loss, front_y)
    _show_axle(car, state, REAR, load_rear, vx, rear[0] - rear_loss, rear_y)


@kernel
def planar_motion(body):
    """Return heading [rad], velocity forward and left [m/s], and yaw rate [rad/s] of a body."""
    forward, _, _ = rotation(body)
    heading = math.atan2(forward[1], forward[0])
    cos, sin = math.cos(heading), math.sin(heading)
    return heading, body[7] * cos + body[8] * sin, body[8] * cos - body[7] * sin, body[12]


@kernel
def footprint(car, body):
    """Return the centre of a body's footprint [m] and its heading in (-pi, pi] [rad].

    The footprint lies where the body's centre line meets the road, so that roll in a bend does not move it.
    """
    forward, _, up = rotation(body)
    x = body[0] - car.centre_to_cog * forward[0] - car.cog_height * up[0]
    y = body[1] - car.centre_to_cog * forward[1] - car.cog_height * up[1]
    # Adding a zero turns -0.0 into 0.0, for which atan2 gives pi and not -pi.
    return x, y, math.atan2(forward[1] + 0.0, forward[0])


@kernel
def overhang(car, body):
    """Return how far a body may reach beyond its footprint, since it is not upright [m]."""
    upright = rotation(body)[2][2]
    tilt = math.sqrt(max(1.0 - upright * upright, 0.0))
    return tilt * (car.half_size[1] + car.cog_height + car.box_height + car.half_size[2])


@kernel
def record_pose(car, body, pose):
    """Write a body's `footprint` into `pose`, shape (3,)."""
    pose[0], pose[1], pose[2] = footprint(car, body)


@kernel
def _axle_loads(car, push):
    """Return the loads of one front and one rear wheel [N] while the tyres push forward with `push` [N]."""
    moved = 0.5 * push * car.cog_height / (car.cog_to_front_axle + car.cog_to_rear_axle)
    return max(car.static_load[FRONT] - moved, 1.0), max(car.static_load[REAR] + moved, 1.0)


@kernel
def _axle_tyre(car, state, wheel, load, friction):
    """Return the `characteristics` of one of an axle's tyres at the mean of both sides' grip."""
    grip = 0.5 * (friction[0] * state.grip_factor[wheel] + friction[1] * state.grip_factor[wheel + 1])
    return characteristics(car, wheel, load, max(grip, LEAST_FRICTION))


@kernel
def _axle_request(car, state, wheel, load, peak, controls, speed):
    """Return an axle's drive force and its resisting force [N].

    Both are cut to the grip of two tyres with the largest force `peak` [N], the drive force also to its
    power.
    """
    limit = 2.0 * peak
    force = car.drive_force
    if force * abs(speed) > car.drive_power:
        force = car.drive_power / abs(speed)
    drive = controls[0] * force * 2.0 * car.drive_share[wheel]
    rolling = 2.0 * car.rolling_resistance + state.extra_resistance[wheel] + state.extra_resistance[wheel + 1]
    resistance = controls[1] * 2.0 * car.brake_torque[wheel] / car.radius[wheel] + rolling * load
    return min(max(drive, -limit), limit), min(resistance, limit)


@kernel
def _net(request, speed):
    """Return the force [N] of an axle's drive and resistance; nothing resists a standing vehicle."""
    return request[0] - (math.copysign(request[1], speed) if speed != 0.0 else 0.0)


@kernel
def _resistance(limit, mass, speed, dt):
    """Return the force [N] against an axle's rolling: no more than stops a mass [kg] within the sub-step."""
    return math.copysign(min(limit, mass * abs(speed) / dt), speed)


@kernel
def _resist(speed, loss):
    """Return a speed after a resistance that would take `loss` [m/s] of it, but never reverses it."""
    return max(speed - loss, 0.0) if speed > 0.0 else min(speed + loss, 0.0)


@kernel
def _axle_side_force(car, state, wheel, tyre, force_x, vx, vy, dt):
    """Return an axle's lateral force [N] beside the longitudinal force `force_x` [N].

    Args:
        car: Parameters.
        state: Deflection and slip angle of the axle's wheels are written.
        wheel: `FRONT` or `REAR`.
        tyre: From `_axle_tyre`.
        force_x: Longitudinal force of both tyres [N].
        vx: Velocity of the contact along the wheel [m/s].
        vy: To its left [m/s].
        dt: [s].
    """
    peak_x, peak_y, _, stiffness, _, curvature = tyre
    carcass = car.carcass_y[wheel] * 0.5 * (state.stiffness_factor[wheel] + state.stiffness_factor[wheel + 1])
    kept = 1.0 / (1.0 + dt * abs(vx) * car.carcass_y[wheel] / stiffness)
    damping = DAMPING_TIME * max(0.0, 1.0 - abs(vx) / DAMPING_SPEED) ** 2
    stretch = car.peak_slip * (1.0 + abs(vy) / BREAKAWAY_SPEED) * peak_y / carcass
    deflection = min(max(kept * (state.deflection_y[wheel] - dt * vy), -stretch), stretch)
    for side in range(wheel, wheel + 2):
        state.deflection_y[side] = deflection
        state.slip_angle[side] = math.atan(carcass * deflection / stiffness)
    pull = carcass * (deflection - damping * vy)
    share = side_share(car, pull / peak_y, curvature)
    used = min(abs(force_x) / (2.0 * peak_x), 0.98)
    return 2.0 * share * pull * math.sqrt(1.0 - used * used)


@kernel
def _slide(body, heading, vx, vy, yaw_rate, dt):
    """Move a body by one sub-step at velocities given in its frame at `heading`, where the sub-step begins.

    The velocity in the world stays what it is while the body turns below it: in the body's frame that is the
    term v x yaw rate of the equations of motion, which does no work.
    """
    _set_velocity(body, math.cos(heading), math.sin(heading), vx, vy, yaw_rate)
    body[0] += dt * body[7]
    body[1] += dt * body[8]
    _set_heading(body, heading + dt * yaw_rate)


@kernel
def _set_velocity(body, cos, sin, vx, vy, yaw_rate):
    """Write a planar velocity, given forward and left of a heading with cosine `cos` and sine `sin`."""
    body[7], body[8], body[9] = vx * cos - vy * sin, vx * sin + vy * cos, 0.0
    body[10], body[11], body[12] = 0.0, 0.0, yaw_rate


@kernel
def _set_heading(body, heading):
    """Write an upright body's heading [rad]."""
    body[3], body[4], body[5], body[6] = 0.0, 0.0, math.sin(0.5 * heading), math.cos(0.5 * heading)


@kernel
def _show_axle(car, state, wheel, load, speed, force_x, force_y):
    """Write an axle's read-out into both of its wheels."""
    for side in range(wheel, wheel + 2):
        state.load[side] = load
        state.spin[side] = speed / (car.radius[side] * state.radius_factor[side])
        state.force_x[side] = 0.5 * force_x
        state.force_y[side] = 0.5 * force_y
        state.slip[side] = 0.0
        state.slip_angle[side] = state.slip_angle[wheel]
