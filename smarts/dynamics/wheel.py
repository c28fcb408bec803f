"""One wheel over one sub-step: its spin, its tyre's bristle and its force, stable at any sub-step length.

The tyre's contact is a bristle (Pacejka 2012, chapter 7, the transient tyre): its deflection e grows with the
sliding speed s and leaks away as the wheel rolls, de/dt = s - |v| e / sigma, with the relaxation length sigma
= slip stiffness over carcass stiffness. Rolling, the force settles at the steady tyre's; standing, nothing
leaks and the bristle is a spring, so that a parked car does not creep. Spin and bristle are advanced
implicitly, because a wheel is light: an explicit step of 10 ms rings or diverges.
"""

from __future__ import annotations

import math

from smarts.dynamics.tyre_models import characteristics, shares
from smarts.geometry.compiling import kernel

DAMPING_TIME = 0.03
"""Force of the standing bristle's damping over its stiffness [s]: a car's corner on it is damped to about
0.5."""
DAMPING_SPEED = 5.0
"""Above this speed [m/s] rolling itself damps the bristle, and the damping above is gone."""
BREAKAWAY_SPEED = 0.5
"""Sliding speed [m/s] over which the bristle may be stretched by another multiple of what breaks it away."""
REGULATED_SPEED = 1.0
"""Below this speed [m/s] ABS lets the wheels lock, so that the car comes to a stand."""
LEAST_FRICTION = 0.01
"""A road without any friction would divide by zero."""
STEERING_RESERVE = 0.3
"""Least share of the peak slip that ABS and traction control leave to braking and driving in a bend."""


@kernel
def roll(car, state, wheel, load, friction, vx, vy, drive, brake, dt):
    """Advance one wheel by `dt` [s] and return its tyre's force (forward, left) [N].

    Args:
        car: A record of `layout.PARAMETERS`.
        state: A record of `layout.STATE`; spin, deflections and read-out are written.
        wheel: 0 to 3.
        load: [N].
        friction: Friction of the road.
        vx: Velocity of the contact along the wheel's heading [m/s].
        vy: To its left [m/s].
        drive: Torque of the engine [N m].
        brake: Largest torque of the brake [N m].
        dt: [s].
    """
    if load <= 0.0:
        _spin_freely(car, state, wheel, drive, brake, dt)
        return 0.0, 0.0
    grip = max(friction * state.grip_factor[wheel], LEAST_FRICTION)
    peak_x, peak_y, stiffness_x, stiffness_y, curvature_x, curvature_y = characteristics(
        car, wheel, load, grip
    )
    factor = state.stiffness_factor[wheel]
    carcass_x, carcass_y = car.carcass_x[wheel] * factor, car.carcass_y[wheel] * factor
    speed = abs(vx)
    # Implicit Euler for the leak; the stiffness factor cancels in the relaxation length.
    kept_x = 1.0 / (1.0 + dt * speed * car.carcass_x[wheel] / stiffness_x)
    kept_y = 1.0 / (1.0 + dt * speed * car.carcass_y[wheel] / stiffness_y)
    damping = DAMPING_TIME * max(0.0, 1.0 - speed / DAMPING_SPEED) ** 2

    slip_y = carcass_y * state.deflection_y[wheel] / peak_y
    peak_slip = car.peak_slip
    reserve = math.sqrt(max(peak_slip**2 - slip_y**2, (STEERING_RESERVE * peak_slip) ** 2))
    spin = _spin(
        car,
        state,
        wheel,
        state.share_x[wheel] * carcass_x * kept_x * state.deflection_x[wheel],
        state.share_x[wheel] * carcass_x * (kept_x * dt + damping),
        reserve * peak_x / (stiffness_x * factor),
        vx,
        drive,
        brake + (car.rolling_resistance + state.extra_resistance[wheel]) * load * car.radius[wheel],
        dt,
    )
    slide = spin * car.radius[wheel] * state.radius_factor[wheel] - vx
    deflection_x = kept_x * (state.deflection_x[wheel] + dt * slide)
    deflection_y = kept_y * (state.deflection_y[wheel] - dt * vy)
    slip_x, slip_y = carcass_x * deflection_x / peak_x, carcass_y * deflection_y / peak_y
    slip = math.sqrt(slip_x * slip_x + slip_y * slip_y)
    stretch = peak_slip * (1.0 + math.sqrt(slide * slide + vy * vy) / BREAKAWAY_SPEED)
    if slip > stretch:
        # A bristle cannot be stretched much beyond breaking away, or the car would spring back as it stops.
        deflection_x, deflection_y = deflection_x * stretch / slip, deflection_y * stretch / slip
    pull_x = carcass_x * (deflection_x + damping * slide)
    pull_y = carcass_y * (deflection_y - damping * vy)
    share_x, share_y = shares(car, pull_x / peak_x, pull_y / peak_y, curvature_x, curvature_y)

    state.spin[wheel] = spin
    state.deflection_x[wheel] = deflection_x
    state.deflection_y[wheel] = deflection_y
    state.share_x[wheel] = max(share_x, 0.0)
    state.slip[wheel] = car.carcass_x[wheel] * deflection_x / stiffness_x
    state.slip_angle[wheel] = math.atan(car.carcass_y[wheel] * deflection_y / stiffness_y)
    return share_x * pull_x, share_y * pull_y


@kernel
def _spin(car, state, wheel, held, slope, peak, vx, drive, brake, dt):
    """Return the wheel's next spin [rad/s].

    The tyre's force is taken as `held` + `slope` * sliding speed, linearised by the last sub-step's
    saturation. `peak` is the slip of the largest force. ABS and traction control are regulators without
    delay: they let as much torque through as holds the wheel at that slip.
    """
    radius = car.radius[wheel] * state.radius_factor[wheel]
    inertia = car.wheel_inertia[wheel]
    resistance = inertia / dt + radius * radius * slope
    free = (inertia / dt * state.spin[wheel] - radius * (held - slope * vx)) / resistance

    driven = free + drive / resistance
    if car.traction_control:
        margin = peak * max(abs(vx), REGULATED_SPEED)
        if drive > 0.0:
            driven = min(driven, max(free, (vx + margin) / radius))
        elif drive < 0.0:
            driven = max(driven, min(free, (vx - margin) / radius))

    reach = brake / resistance
    braked = driven - reach if driven > reach else (driven + reach if driven < -reach else 0.0)
    if car.abs and abs(vx) > REGULATED_SPEED:
        limit = vx * (1.0 - min(peak, 1.0)) / radius
        braked = max(braked, min(driven, limit)) if vx > 0.0 else min(braked, max(driven, limit))
    return braked


@kernel
def _spin_freely(car, state, wheel, drive, brake, dt):
    """Advance a wheel in the air: nothing but drive and brake act on it."""
    spin = state.spin[wheel] + dt * drive / car.wheel_inertia[wheel]
    reach = dt * brake / car.wheel_inertia[wheel]
    state.spin[wheel] = max(spin - reach, 0.0) if spin > 0.0 else min(spin + reach, 0.0)
    state.deflection_x[wheel] = 0.0
    state.deflection_y[wheel] = 0.0
    state.share_x[wheel] = 1.0
    state.slip[wheel] = 0.0
    state.slip_angle[wheel] = 0.0
