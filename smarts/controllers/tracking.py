"""The tracking law: steers along a reference and holds its speed at 100 Hz.

Lateral: feedforward of the steady-state steering for the reference's curvature (from wheelbase and tyres'
understeer), plus feedback on the offset at a look-ahead distance (Kapania and Gerdes, Vehicle System Dynamics
53(12), 2015); the heading error accounts for steady-state side slip. Gain and look-ahead follow from the
desired natural frequency and damping of the lateral motion, so they depend on speed and wheelbase.
Longitudinal: feedforward of the force for the desired acceleration, plus proportional-integral feedback.
Integrals are frozen while the actuator saturates or the error is large.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from smarts.arrays import Bools, Bytes, Floats, Ints, Longs
from smarts.dynamics.layout import GRAVITY, FleetArrays
from smarts.dynamics.single_track import (
    axles_of,
    centre_of,
    footprint,
    planar_motion,
    roll,
    rolling_motion,
    stop_rolling,
)
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import interpolate_angle, project, wrapped
from smarts.types.actions import CommandMode

SPEED_INTEGRAL, OFFSET_INTEGRAL, CURVATURE, MEMORY = 0, 1, 2, 3
"""Columns of a vehicle's tracking memory, and their number."""

FREQUENCY = 1.8
"""Natural frequency of the lateral motion of fast vehicles [rad/s]."""
FREQUENCY_PER_WHEELBASE = 0.7
"""The same for slow vehicles, in radians per wheelbase of travel."""
STEERED_TURN = 0.4
"""Heading error that the steering can correct at its maximum rate [rad]; limits the frequency."""
DAMPING = 1.0
"""Damping ratio of the lateral motion."""
STEERING_DELAY = 0.15
"""Delay of the steering [s]."""
LEAST_SPEED = 1.0
"""Lower bound of the speed in gains [m/s]."""
FARTHEST_OFFSET = 0.5
"""Offsets are clipped to this magnitude in the lateral feedback [m]."""
OFFSET_RATE = 0.15
"""Ratio of integral to proportional lateral feedback [1/s]."""
TRIMMED_TURN = 0.02
"""The lateral integral is frozen while the heading error exceeds this angle [rad]."""
STEERING_TRIM = 0.03
"""Maximum steering by the integral [rad]."""

SPEED_GAIN = 1.5
"""Acceleration per speed error [1/s]."""
SPEED_RATE = 0.3
"""Ratio of integral to proportional speed feedback [1/s]."""
ACCELERATION_TRIM = 1.0
"""Maximum acceleration by the integral [m/s^2]."""
MOST_ACCELERATION = 3.0
MOST_DECELERATION = 7.0
"""Bounds of the commanded acceleration [m/s^2]."""
STANDING_SPEED = 0.2
"""If target and actual speed are below this, the brakes hold the vehicle [m/s]."""
HOLDING_BRAKE = 0.4
"""Brake of a standing vehicle, in [0, 1]."""

FAR, NEAR = 100.0, 4.0
"""Where the search for the nearest segment ends, see `_foot`, and of kinematic vehicles [m^2]."""


_ACTUATORS = int(CommandMode.ACTUATORS)
_RATE = int(CommandMode.ACTUATORS_RATE)
_TRACK = int(CommandMode.TRACK)


class Followed(NamedTuple):
    """What vehicles follow, and what the law remembers; row *i* of every array is vehicle *i*."""

    mode: Bytes
    """A `CommandMode`, shape (E,)."""
    actuators: Floats
    """See `Commands`, shape (E, 3)."""
    reference: Floats
    """See `Commands`, shape (E, R, 4)."""
    length: Ints
    """Number of points of the reference, shape (E,)."""
    window: Floats
    """See `Commands`, shape (E,)."""
    slips: Bools
    """Whether the vehicle's tyres slip sideways, shape (E,)."""
    memory: Floats
    """Memory of the tracking law, written, shape (E, MEMORY)."""
    shown: Floats
    """A copy of the controls, written, shape (E, 3)."""


@kernel
def drive(fleet: FleetArrays, followed: Followed, rows: Longs) -> None:
    """Write the controls of the vehicles of `rows`, shape (N,), for one sub-step."""
    for row in rows:
        x, y, _ = footprint(fleet.cars[row], fleet.bodies[row])
        heading, vx, _, _ = planar_motion(fleet.bodies[row])
        _control(fleet, followed, row, (x, y, heading, vx), FAR)


@kernel
def drive_kinematic(fleet: FleetArrays, followed: Followed, rows: Longs) -> None:
    """Drive kinematic vehicles through all sub-steps of a step, one after the other: they touch nothing."""
    for row in rows:
        car, state, pose = fleet.cars[row], fleet.states[row], fleet.poses[row]
        axles, motion = axles_of(car, state, fleet.road[row]), rolling_motion(car, state, fleet.bodies[row])
        x, y = centre_of(car, motion)
        for substep in range(len(pose)):
            _control(fleet, followed, row, (x, y, motion[2], motion[5]), NEAR)
            motion = roll(car, state, axles, motion, fleet.controls[row], fleet.dt)
            x, y = centre_of(car, motion)
            pose[substep, 0], pose[substep, 1], pose[substep, 2] = x, y, motion[2]
        stop_rolling(car, state, axles, motion, fleet.bodies[row])


@kernel
def _control(fleet, followed, row, pose, far):
    """Write one vehicle's controls for a sub-step.

    Args:
        fleet: The fleet.
        followed: What its vehicles follow.
        row: The vehicle.
        pose: Centre of its footprint x, y [m], its heading [rad] and its speed [m/s].
        far: See `_foot`.
    """
    car, state, controls, mode = fleet.cars[row], fleet.states[row], fleet.controls[row], followed.mode[row]
    if mode == _TRACK and followed.length[row] >= 2:
        _track(car, followed, row, pose, far, controls, fleet.dt)
    elif mode in (_ACTUATORS, _RATE):
        controls[0], controls[1], steering = followed.actuators[row]
        if mode == _RATE:
            steering = state.steering / car.max_steering + steering * fleet.dt
        controls[2] = min(max(steering, -1.0), 1.0)
    else:
        controls[0], controls[1] = 0.0, 0.0
        controls[2] = state.steering / car.max_steering
    for column in range(3):
        followed.shown[row, column] = controls[column]


@kernel
def _track(car, followed, row, pose, far, controls, dt):
    """Write the controls of one vehicle that tracks a reference; see the module docstring."""
    x, y, heading, vx = pose
    reference, length, memory = followed.reference[row], followed.length[row], followed.memory[row]
    segment, share, offset = _foot(reference, length, x, y, far)
    window = max(followed.window[row], 0.3 * max(abs(vx), LEAST_SPEED))
    slips = followed.slips[row]
    controls[2] = _steering(
        car, heading, vx, reference, length, segment, share, offset, window, slips, memory, dt
    )
    _hold_speed(car, vx, reference, length, segment, share, memory, controls, dt)


@kernel
def _foot(reference, length, x, y, far):
    """Return the nearest segment of a reference, the position on it in [0, 1], and the left offset [m].

    The search ends at a segment whose squared distance is larger by `far` [m^2] than the least before it.
    """
    best, best_square, best_share, best_cross = 0, np.inf, 0.0, 0.0
    for point in range(length - 1):
        a, b = reference[point], reference[point + 1]
        share, square, cross = project(x, y, a[0], a[1], b[0], b[1])
        if square < best_square:
            best, best_square, best_share, best_cross = point, square, share, cross
        elif square > best_square + far:
            break
    a, b = reference[best], reference[best + 1]
    span = math.hypot(b[0] - a[0], b[1] - a[1])
    # Beyond its ends the reference is extended straight; between two segments, measure to the corner.
    if (best_share < 0.0 and best == 0) or (best_share > 1.0 and best == length - 2):
        offset = best_cross / max(span, 1e-6)
    else:
        offset = math.copysign(math.sqrt(best_square), best_cross)
    return best, min(1.0, max(0.0, best_share)), offset


@kernel
def _heading_ahead(reference, length, segment, share, distance):
    """Return the reference's heading [rad] at `distance` [m] ahead of a position on it, or at its end."""
    a, b = reference[segment], reference[segment + 1]
    span = math.hypot(b[0] - a[0], b[1] - a[1])
    distance += share * span
    while distance > span and segment < length - 2:
        distance -= span
        segment += 1
        a, b = reference[segment], reference[segment + 1]
        span = math.hypot(b[0] - a[0], b[1] - a[1])
    return interpolate_angle(a[2], b[2], min(1.0, distance / max(span, 1e-6)))


@kernel
def _steering(car, heading, vx, reference, length, segment, share, offset, window, slips, memory, dt):
    """Return the steering in [-1, 1] of full lock."""
    speed = max(abs(vx), LEAST_SPEED)
    wheelbase = car.cog_to_front_axle + car.cog_to_rear_axle
    front, rear = 2.0 * car.linear_y[0], 2.0 * car.linear_y[2]
    rear_slip = understeer = 0.0
    if slips:
        per_acceleration = car.mass / wheelbase
        rear_slip = per_acceleration * car.cog_to_front_axle / rear
        understeer = per_acceleration * car.cog_to_rear_axle / front - rear_slip

    # The path of the footprint's centre responds to steering over the distance to the rear axle (less at
    # speed, when the rear slips outwards). So the curvature is looked up ahead by the steering delay, and
    # low-pass filtered with the vehicle's own lag.
    centre_to_rear = car.cog_to_rear_axle - car.centre_to_cog
    ahead = STEERING_DELAY * speed
    here = _heading_ahead(reference, length, segment, share, 0.0)
    first = _heading_ahead(reference, length, segment, share, ahead)
    last = _heading_ahead(reference, length, segment, share, ahead + window)
    lag = max(centre_to_rear - rear_slip * speed * speed, 0.0) + 0.5 * window
    memory[CURVATURE] += (wrapped(last - first) / window - memory[CURVATURE]) * min(abs(vx) * dt / lag, 1.0)
    curvature = memory[CURVATURE]

    # Feedback faster than the steering rate would oscillate.
    followed = math.sqrt(car.steering_rate * speed / (2.0 * DAMPING * wheelbase * STEERED_TURN))
    frequency = min(FREQUENCY, FREQUENCY_PER_WHEELBASE * speed / wheelbase, followed)
    yaw_length = wheelbase + max(understeer, 0.0) * speed * speed
    gain = yaw_length * frequency * frequency / (speed * speed)
    look_ahead = 2.0 * DAMPING * speed / frequency
    side_slip = curvature * (centre_to_rear - rear_slip * speed * speed)
    course = wrapped(heading + side_slip - here)
    error = min(max(offset, -FARTHEST_OFFSET), FARTHEST_OFFSET)
    needed = math.atan(wheelbase * curvature) + understeer * speed * speed * curvature
    feedback = -gain * (error + look_ahead * math.sin(min(max(course, -1.2), 1.2)))
    desired = (needed + feedback + memory[OFFSET_INTEGRAL]) / car.max_steering
    if (
        abs(desired) < 1.0
        and abs(offset) < FARTHEST_OFFSET
        and abs(course) < TRIMMED_TURN
        and vx > LEAST_SPEED
    ):
        trim = memory[OFFSET_INTEGRAL] - OFFSET_RATE * gain * error * dt
        memory[OFFSET_INTEGRAL] = min(max(trim, -STEERING_TRIM), STEERING_TRIM)
    return min(max(desired, -1.0), 1.0)


@kernel
def _hold_speed(car, vx, reference, length, segment, share, memory, controls, dt):
    """Write throttle and brake, `controls[0]` and `controls[1]`, in [0, 1]."""
    a, b = reference[segment], reference[segment + 1]
    span = math.hypot(b[0] - a[0], b[1] - a[1])
    begin, end = a[3] * a[3], b[3] * b[3]
    at_end = share >= 1.0 and segment == length - 2
    target = math.sqrt(max(begin + share * (end - begin), 0.0))
    slowing = 0.0 if at_end else min(0.5 * (end - begin) / max(span, 1e-6), 0.0)
    if target < STANDING_SPEED and vx < STANDING_SPEED:
        controls[0], controls[1] = 0.0, HOLDING_BRAKE
        memory[SPEED_INTEGRAL] = 0.0
        return
    error = target - vx
    # A vehicle slower than the reference need not brake with it yet.
    slowing *= min(max(1.0 - error, 0.0), 1.0)
    desired = slowing + SPEED_GAIN * error + memory[SPEED_INTEGRAL]
    acceleration = min(max(desired, -MOST_DECELERATION), MOST_ACCELERATION)
    resistance = car.drag * vx * abs(vx) + car.rolling_resistance * car.mass * GRAVITY
    force = car.mass * acceleration + resistance
    available = car.drive_force
    if available * vx > car.drive_power:
        available = car.drive_power / vx
    braking = 0.0
    for wheel in range(4):
        braking += car.brake_torque[wheel] / car.radius[wheel]
    controls[0] = min(max(force / available, 0.0), 1.0)
    controls[1] = min(max(-force / braking, 0.0), 1.0)
    if abs(error) < 1.0 and acceleration == desired and force < available:
        trim = memory[SPEED_INTEGRAL] + SPEED_RATE * SPEED_GAIN * error * dt
        memory[SPEED_INTEGRAL] = min(max(trim, -ACCELERATION_TRIM), ACCELERATION_TRIM)
