"""Derivatives of both single-track models against published equations, written here in plain NumPy.

Kinematic: R. Rajamani, Vehicle Dynamics and Control, 2nd ed. 2012, section 2.2, and the kinematic single
track of CommonRoad's vehicle models (Althoff, Koschi, Manzinger, IV 2017), whose state is the rear axle's
speed. Dynamic: Rajamani, section 2.3 (the plane's equations of motion, and their linear form 2.31), with the
Magic Formula of Pacejka, Tire and Vehicle Dynamics, 3rd ed. 2012, section 4.3.2, and the friction ellipse.
"""

import math

import numpy as np
import pytest

from smarts.dynamics import TYRE_MODELS, Fleet
from smarts.dynamics.layout import GRAVITY
from smarts.types.streams import Purpose, stream
from tests.unit.dynamics.by_hand import EACH, FRONT, REAR, Car

STEP = 1e-6
"""Step of the derivatives [s]: errors are some 1e-9 by rounding and 1e-4 by truncation, in m/s^2."""


def planar(fleet):
    """Heading, velocity forward and left, yaw rate of the only vehicle."""
    body = fleet.body(0)
    heading = 2.0 * math.atan2(body[5], body[6])
    forward, left = (
        np.array([math.cos(heading), math.sin(heading)]),
        np.array([-math.sin(heading), math.cos(heading)]),
    )
    return heading, body[7:9] @ forward, body[7:9] @ left, body[12], body[0:2].copy()


def derivatives(fleet, controls):
    """Rates of heading, forward and left velocity, yaw rate and position; the vehicle is removed then."""
    before = planar(fleet)
    fleet.step(np.array([controls]))
    after = planar(fleet)
    fleet.despawn(0)
    rates = [(new - old) / STEP for old, new in zip(before[:4], after[:4], strict=True)]
    return *rates, (after[4] - before[4]) / STEP


@pytest.fixture
def fleet():
    with Fleet(1, 1, step=STEP, substeps=1) as made:
        yield made


@pytest.mark.parametrize("name", EACH)
def test_kinematic_model(fleet, name):
    car, draw = Car(name), stream(11, Purpose.STARTS)
    for _ in range(200):
        speed, heading = draw.uniform(0.5, 30.0) * draw.choice([-1.0, 1.0]), draw.uniform(-3.0, 3.0)
        angle = draw.uniform(-0.95, 0.95) * car.record.steering.max_angle
        turning = draw.choice([-1.0, 0.0, 1.0])
        throttle, brake = (
            (draw.uniform(0.0, 0.2), 0.0) if draw.random() < 0.5 else (0.0, draw.uniform(0.0, 0.2))
        )
        fleet.spawn(0, name, (3.0, 4.0), heading, speed, steering=angle, model="kinematic")
        command = turning if turning else angle / car.record.steering.max_angle
        turn, accelerating, _, _, moving = derivatives(fleet, (throttle, brake, command))
        # Rajamani 2.2, of the centre of gravity with side slip beta; CommonRoad's state is the rear axle's v.
        beta = math.atan(car.lr * math.tan(angle) / car.wheelbase)
        v = speed / math.cos(beta)
        assert moving == pytest.approx([v * math.cos(heading + beta), v * math.sin(heading + beta)], abs=3e-4)
        assert turn == pytest.approx(v * math.cos(beta) * math.tan(angle) / car.wheelbase, abs=1e-4)
        # Both take v's rate as given. Here it follows from the work of the forces: d/dt (m V^2 + I r^2) / 2.
        k = math.tan(angle) / car.wheelbase
        k_rate = turning * car.record.steering.rate / (car.wheelbase * math.cos(angle) ** 2)
        mass = car.m * (1.0 + (car.lr * k) ** 2) + car.iz * k * k
        mass_rate = 2.0 * (car.m * car.lr**2 + car.iz) * k * k_rate
        rolling = speed / math.cos(angle)
        power = -car.air * abs(v) ** 3
        for end, along in ((FRONT, rolling), (REAR, speed)):
            push, resisting = car.forces_along(end, throttle, brake, car.static[end], along)
            power += push * along - resisting * abs(along)
        expected = (power - 0.5 * mass_rate * speed**2) / (mass * speed)
        assert accelerating == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize("tyres", TYRE_MODELS)
@pytest.mark.parametrize("name", EACH)
def test_dynamic_model(fleet, name, tyres):
    car, draw = Car(name), stream(12, Purpose.STARTS)
    slid = compared = 0
    for _ in range(200):
        vx, vy, r = draw.uniform(8.0, 35.0), draw.uniform(-4.0, 4.0), draw.uniform(-0.8, 0.8)
        angle, friction = draw.uniform(-0.3, 0.3), draw.choice([0.3, 0.6, 0.9])
        throttle, brake = (
            (draw.uniform(0.0, 0.1), 0.0) if draw.random() < 0.5 else (0.0, draw.uniform(0.0, 0.05))
        )
        pushed = draw.uniform(-0.1, 0.1) * car.m * GRAVITY
        load = car.loads(pushed)
        cos, sin = math.cos(angle), math.sin(angle)
        front_y = vy + car.lf * r
        along = {FRONT: vx * cos + front_y * sin, REAR: vx}
        slip = {FRONT: (vx * sin - front_y * cos) / along[FRONT], REAR: (car.lr * r - vy) / vx}
        aside = {FRONT: front_y * cos - vx * sin, REAR: vy - car.lr * r}
        if any(car.is_stretched(end, load[end], friction, slip[end], aside[end]) for end in aside):
            continue
        compared += 1
        fleet.spawn(0, name, (0.0, 0.0), 0.7, 10.0, model="dynamic", tyres=tyres, steering=angle)
        fleet.road.friction[:] = friction
        body, state = fleet._bodies[0], fleet._states[0]
        body[7:9] = vx * math.cos(0.7) - vy * math.sin(0.7), vx * math.sin(0.7) + vy * math.cos(0.7)
        body[12] = r
        # Tyres that have settled, and the push that has moved the load.
        state["force_x"] = 0.25 * pushed
        for end in (FRONT, REAR):
            at = car.static[end] if tyres == "linear" else load[end]
            stiffness = car.cornering_stiffness(end, at)
            settled = stiffness * slip[end] / fleet._cars["carcass_y"][0, end]
            state["deflection_y"][end : end + 2] = settled
        command = angle / car.record.steering.max_angle
        turn, ax, ay, yawing, moving = derivatives(fleet, (throttle, brake, command))
        fx, fy = {}, {}
        for end in (FRONT, REAR):
            push, resisting = car.forces_along(end, throttle, brake, load[end], along[end])
            fx[end] = push - resisting
            used = abs(fx[end]) / (2.0 * car.largest_x(end, load[end], friction, tyres))
            lateral = 2.0 * car.side_force(end, load[end], friction, slip[end], tyres)
            fy[end] = lateral * math.sqrt(1.0 - used**2)
            slid += abs(lateral) > 1.5 * friction * load[end]
        drag = car.air * math.hypot(vx, vy)
        # Rajamani 2.3; the velocity's components turn with the vehicle.
        forward = fx[REAR] + fx[FRONT] * cos - fy[FRONT] * sin - drag * vx
        across = fy[REAR] + fy[FRONT] * cos + fx[FRONT] * sin - drag * vy
        moment = car.lf * (fy[FRONT] * cos + fx[FRONT] * sin) - car.lr * fy[REAR]
        assert ax == pytest.approx(forward / car.m + vy * r, abs=5e-3)
        assert ay == pytest.approx(across / car.m - vx * r, abs=5e-3)
        assert yawing == pytest.approx(moment / car.iz, abs=5e-3)
        assert turn == pytest.approx(r, abs=1e-4)
        course = 0.7 + math.atan2(vy, vx)
        assert moving == pytest.approx(
            math.hypot(vx, vy) * np.array([math.cos(course), math.sin(course)]), abs=1e-4
        )
    assert compared > 120
    assert slid > 10, "some tyres are near their limit"
