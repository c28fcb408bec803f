"""The one tracking law: steers along a reference and holds its speed, 100 times a second.

Lateral: the steering that the reference's curvature takes in steady state (wheelbase, and understeer of the
vehicle's own tyres), plus feedback on the offset a look-ahead distance in front (Kapania and Gerdes, Vehicle
System Dynamics 53(12), 2015), the heading being compared with the one that a vehicle which side-slips
steadily has there. Gain and look-ahead follow from the natural frequency and damping that the lateral motion
is to have, so that they are scheduled by speed and wheelbase. Longitudinal: the force that the wanted
acceleration takes, plus a proportional-integral part for what the model does not know. Integrals stand still
while the actuator is at its bound or the error is large.
"""

from __future__ import annotations

import math

import numpy as np

from smarts.arrays import Bools, Bytes, Floats, Ints, Longs
from smarts.dynamics.layout import GRAVITY, FleetArrays
from smarts.dynamics.single_track import planar_motion, record_pose
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import interpolate_angle, project, wrapped
from smarts.types.actions import CommandMode, Commands

SPEED_INTEGRAL, OFFSET_INTEGRAL, CURVATURE, MEMORY = 0, 1, 2, 3
"""Columns of what a vehicle's tracking remembers, and how many there are."""

FREQUENCY = 1.8
"""Natural frequency of the lateral motion at speed [rad/s]."""
FREQUENCY_PER_WHEELBASE = 0.7
"""The same for slow vehicles, in radians per wheelbase driven."""
STEERED_TURN = 0.4
"""The largest error of heading that the steering, at its rate, still answers in time [rad]."""
DAMPING = 1.0
"""Damping of the lateral motion."""
STEERING_DELAY = 0.15
"""Delay of the steering [s]."""
LEAST_SPEED = 1.0
"""At which gains are taken for vehicles that hardly move [m/s]."""
FARTHEST_OFFSET = 0.5
"""The lateral feedback goes no further than it does at this offset [m]."""
OFFSET_RATE = 0.15
"""Integral over proportional lateral feedback [1/s]."""
TRIMMED_TURN = 0.02
"""The integral runs only while the vehicle goes along the reference to within this angle [rad]."""
STEERING_TRIM = 0.03
"""The most steering that the integral gives [rad]."""

SPEED_GAIN = 1.5
"""Acceleration over speed error [1/s]."""
SPEED_RATE = 0.3
"""Integral over proportional feedback [1/s]."""
ACCELERATION_TRIM = 1.0
"""The most acceleration that the integral gives [m/s^2]."""
MOST_ACCELERATION = 3.0
MOST_DECELERATION = 7.0
"""[m/s^2]"""
STANDING_SPEED = 0.2
"""A vehicle that is to stand and is slower than this is held by its brakes [m/s]."""
HOLDING_BRAKE = 0.4


_ACTUATORS = int(CommandMode.ACTUATORS)
_RATE = int(CommandMode.ACTUATORS_RATE)
_TRACK, _PLACE = int(CommandMode.TRACK), int(CommandMode.PLACE)
_NONE = int(CommandMode.NONE)


@kernel
def drive(
    fleet: FleetArrays,
    mode: Bytes,
    actuators: Floats,
    reference: Floats,
    length: Ints,
    windows: Floats,
    slips: Bools,
    memory: Floats,
    shown: Floats,
    rows: Longs,
) -> None:
    """Write the controls of vehicles for one sub-step from their commands.

    Args:
        fleet: The fleet; `controls` is written.
        mode: A `CommandMode`, shape (E,).
        actuators: Shape (E, 3), see `Commands`.
        reference: Shape (E, R, 4), see `Commands`.
        length: Points of each reference, shape (E,).
        windows: See `Commands`, shape (E,).
        slips: Whether the vehicle's tyres slip sideways, shape (E,).
        memory: Shape (E, MEMORY); written.
        shown: Written: the controls again, shape (E, 3).
        rows: The vehicles, shape (R,).
    """
    pose = np.empty(3)
    cars, states, bodies, controls = fleet.cars, fleet.states, fleet.bodies, fleet.controls
    for row in rows:
        if mode[row] == _TRACK and length[row] >= 2:
            record_pose(cars[row], bodies[row], pose)
            _track(
                cars[row],
                states[row],
                planar_motion(bodies[row]),
                pose,
                reference[row],
                length[row],
                windows[row],
                slips[row],
                memory[row],
                controls[row],
                fleet.dt,
            )
        elif mode[row] == _ACTUATORS or mode[row] == _RATE:
            controls[row, 0], controls[row, 1] = actuators[row, 0], actuators[row, 1]
            steering = actuators[row, 2]
            if mode[row] == _RATE:
                steering = states[row].steering / cars[row].max_steering + steering * fleet.dt
            controls[row, 2] = min(max(steering, -1.0), 1.0)
        else:
            controls[row, 0], controls[row, 1] = 0.0, 0.0
            controls[row, 2] = states[row].steering / cars[row].max_steering
        for column in range(3):
            shown[row, column] = controls[row, column]


@kernel
def first_bad_command(commands: Commands, active: Bools) -> int:
    """Return the first active row b * A + a whose command holds a number that is not finite, or -1."""
    mode, actuators, poses = commands.mode, commands.actuators, commands.poses
    for b in range(active.shape[0]):
        for a in range(active.shape[1]):
            if not active[b, a] or mode[b, a] == _NONE:
                continue
            if mode[b, a] == _TRACK:
                total = _sum(commands.reference[b, a], commands.reference_length[b, a])
            elif mode[b, a] == _PLACE:
                total = _sum(poses[b, a], poses.shape[2])
            else:
                total = actuators[b, a, 0] + actuators[b, a, 1] + actuators[b, a, 2]
            if not math.isfinite(total):
                return b * active.shape[1] + a
    return -1


@kernel
def _sum(rows, count):
    """Return the sum of the first rows of a table."""
    total = 0.0
    for row in range(count):
        for column in range(rows.shape[1]):
            total += rows[row, column]
    return total


@kernel
def _track(car, state, motion, pose, reference, length, window, slips, memory, controls, dt):
    """Write the controls of one vehicle that follows a reference; see the module."""
    heading, vx, _, _ = motion
    segment, share, offset = _foot(reference, length, pose[0], pose[1])
    window = max(window, 0.3 * max(abs(vx), LEAST_SPEED))
    controls[2] = _steering(
        car, heading, vx, reference, length, segment, share, offset, window, slips, memory, dt
    )
    _hold_speed(car, vx, reference, length, segment, share, memory, controls, dt)


@kernel
def _foot(reference, length, x, y):
    """Return the nearest segment of a reference, the share of it, and the offset to the left [m]."""
    best, best_square, best_share, best_cross = 0, np.inf, 0.0, 0.0
    for point in range(length - 1):
        a, b = reference[point], reference[point + 1]
        share, square, cross = project(x, y, a[0], a[1], b[0], b[1])
        if square < best_square:
            best, best_square, best_share, best_cross = point, square, share, cross
        elif square > best_square + 100.0:
            break
    a, b = reference[best], reference[best + 1]
    span = math.hypot(b[0] - a[0], b[1] - a[1])
    # Beyond an end the reference is extended straight, between two segments the corner counts.
    if (best_share < 0.0 and best == 0) or (best_share > 1.0 and best == length - 2):
        offset = best_cross / max(span, 1e-6)
    else:
        offset = math.copysign(math.sqrt(best_square), best_cross)
    return best, min(1.0, max(0.0, best_share)), offset


@kernel
def _heading_ahead(reference, length, segment, share, distance):
    """Return the reference's heading [rad] a distance [m] ahead of a foot, at most at its end."""
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
    """Return the steering in [-1, 1] of the lock."""
    speed = max(abs(vx), LEAST_SPEED)
    wheelbase = car.cog_to_front_axle + car.cog_to_rear_axle
    front, rear = 2.0 * car.linear_y[0], 2.0 * car.linear_y[2]
    rear_slip = understeer = 0.0
    if slips:
        per_acceleration = car.mass / wheelbase
        rear_slip = per_acceleration * car.cog_to_front_axle / rear
        understeer = per_acceleration * car.cog_to_rear_axle / front - rear_slip

    # Seen from the footprint's centre, a vehicle swings into a curve over the distance to its rear axle
    # (less at speed, when its rear slips outwards). So the curvature is looked up as far ahead as the
    # steering is late, and follows with the vehicle's own lag.
    centre_to_rear = car.cog_to_rear_axle - car.centre_to_cog
    ahead = STEERING_DELAY * speed
    here = _heading_ahead(reference, length, segment, share, 0.0)
    first = _heading_ahead(reference, length, segment, share, ahead)
    last = _heading_ahead(reference, length, segment, share, ahead + window)
    lag = max(centre_to_rear - rear_slip * speed * speed, 0.0) + 0.5 * window
    memory[CURVATURE] += (wrapped(last - first) / window - memory[CURVATURE]) * min(abs(vx) * dt / lag, 1.0)
    curvature = memory[CURVATURE]

    # Faster than the steering turns, feedback only swings.
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
    wanted = (needed + feedback + memory[OFFSET_INTEGRAL]) / car.max_steering
    if (
        abs(wanted) < 1.0
        and abs(offset) < FARTHEST_OFFSET
        and abs(course) < TRIMMED_TURN
        and vx > LEAST_SPEED
    ):
        trim = memory[OFFSET_INTEGRAL] - OFFSET_RATE * gain * error * dt
        memory[OFFSET_INTEGRAL] = min(max(trim, -STEERING_TRIM), STEERING_TRIM)
    return min(max(wanted, -1.0), 1.0)


@kernel
def _hold_speed(car, vx, reference, length, segment, share, memory, controls, dt):
    """Write throttle and brake."""
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
    # Slower than the reference, the vehicle need not brake with it yet.
    slowing *= min(max(1.0 - error, 0.0), 1.0)
    wanted = slowing + SPEED_GAIN * error + memory[SPEED_INTEGRAL]
    acceleration = min(max(wanted, -MOST_DECELERATION), MOST_ACCELERATION)
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
    if abs(error) < 1.0 and acceleration == wanted and force < available:
        trim = memory[SPEED_INTEGRAL] + SPEED_RATE * SPEED_GAIN * error * dt
        memory[SPEED_INTEGRAL] = min(max(trim, -ACCELERATION_TRIM), ACCELERATION_TRIM)
