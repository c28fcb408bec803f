import math

import numpy as np
import pytest

from smarts.dynamics import vehicle
from smarts.dynamics.layout import GRAVITY, pack
from tests.unit.dynamics.by_hand import EACH


@pytest.mark.parametrize("model", ["dynamic", "kinematic"])
@pytest.mark.parametrize("friction", [0.9, 0.4])
def test_stopping_distance(rig, model, friction):
    assert rig(speed=20.0, friction=friction, model=model).stop() == pytest.approx(
        400.0 / (2.0 * friction * GRAVITY), rel=0.03
    )


@pytest.mark.parametrize("model", ["dynamic", "kinematic"])
def test_stands_still_under_the_brake(rig, model):
    car = rig(speed=3.0, model=model).drive(3.0, brake=1.0, steering=0.5)
    before = car.position.copy()
    car.drive(10.0, brake=1.0)
    assert np.linalg.norm(car.position - before) < 1e-3
    assert car.speed == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("name", EACH)
def test_kinematic_rear_axle_rolls_on_the_circle_of_its_steering(rig, name):
    """At any speed; nothing slows it."""
    record, angle = vehicle(name), 0.35
    radius = record.wheelbase / math.tan(angle)
    for speed in (3.0, -3.0, 25.0):
        car = rig(name, speed=speed, steering=angle, model="kinematic")
        car.fleet._cars["rolling_resistance"] = car.fleet._cars["drag"] = 0.0
        back = record.cog_to_rear_axle - record.centre_to_cog
        middle = -back * np.array([1.0, 0.0]) + [0.0, radius]
        for step in range(40):
            car.once(0.0, 0.0, angle / record.steering.max_angle)
            x, y, heading = car.fleet.motion.substeps[0].T
            rear = np.stack([x - back * np.cos(heading), y - back * np.sin(heading)])
            turned = speed / radius * (0.1 * step + 0.01 * np.arange(1, 11))
            circle = middle[:, None] + radius * np.stack([np.sin(turned), -np.cos(turned)])
            assert rear == pytest.approx(circle, abs=1e-9)
        assert car.speed == pytest.approx(speed, rel=1e-12)


def test_steady_cornering_is_the_linear_theory(rig):
    """Yaw rate = v delta / (L + K v^2) with the understeer gradient of Rajamani (2012), equation 3.3."""
    speed, car, record = 15.0, vehicle("passenger"), pack("passenger", "linear")
    front, rear = 2.0 * record["linear_y"][[0, 2]]
    gradient = car.mass / car.wheelbase * (car.cog_to_rear_axle / front - car.cog_to_front_axle / rear)
    drive = rig(speed=speed, model="dynamic", tyres="linear").hold(speed, 6.0, steering=0.02)
    expected = drive.speed * drive.steering / (car.wheelbase + gradient * drive.speed**2)
    assert drive.yaw_rate == pytest.approx(expected, rel=0.02)


def test_slides_where_grip_ends(rig):
    car = rig(speed=20.0, friction=0.3, model="dynamic").drive(3.0, steering=1.0)
    assert car.speed * car.yaw_rate < 0.3 * GRAVITY * 1.05
    kinematic = rig(speed=20.0, friction=0.3, model="kinematic").drive(3.0, steering=1.0)
    assert kinematic.speed * kinematic.yaw_rate > 3.0 * GRAVITY, "the kinematic one knows no grip sideways"
