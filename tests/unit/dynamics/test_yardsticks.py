"""The simulator rows of the project's yardsticks, and cases that a page of paper settles.

Stopping distances have a file of their own, `test_stopping.py`.
"""

import math

import numpy as np
import pytest

from smarts.dynamics import FLAT_TYRE, Fleet, vehicle
from smarts.dynamics.layout import GRAVITY
from tests.unit.dynamics.by_hand import EACH


@pytest.mark.parametrize("model", ["bullet", "dynamic", "kinematic"])
@pytest.mark.parametrize("name", EACH)
def test_steady_turning_radius(rig, name, model):
    car = rig(name, speed=3.0, model=model).hold(3.0, 10.0, steering=0.5)
    radius = car.speed / car.yaw_rate
    assert radius == pytest.approx(vehicle(name).wheelbase / math.tan(car.steering), rel=0.02)
    # The rear axle's circle, measured from its own positions.
    pose = car.fleet.motion.substeps[0]
    spun = (pose[-1, 2] - pose[0, 2]) / 0.09
    assert spun == pytest.approx(car.yaw_rate, rel=0.01)


@pytest.mark.parametrize("name", EACH)
def test_parked_on_a_slope(rig, name):
    car = rig(name, slope=0.05).drive(5.0, brake=1.0)
    before = car.position.copy()
    car.drive(20.0, brake=1.0)
    assert np.linalg.norm(car.position - before) / 20.0 < 1e-6
    assert np.linalg.norm(before) < 0.01, "the tyre's deflection, not creep"


def test_unbraked_car_rolls_down(rig):
    car = rig(slope=0.05).drive(10.0)
    expected = (0.05 - 0.00702) * GRAVITY / math.hypot(1.0, 0.05)
    # The wheels' spin adds 4 * 1.7 / 0.3135^2 = 69 kg to 1093 kg of inertia.
    assert car.speed == pytest.approx(-expected * 10.0 * 1093.3 / (1093.3 + 69.2), rel=0.02)


@pytest.mark.parametrize("speed", [0.3, 3.0, 30.0])
@pytest.mark.parametrize("name", ["passenger", "bus"])
def test_no_ripple_at_constant_speed(rig, name, speed):
    car = rig(name, speed=speed, step=0.01, substeps=1).hold(speed, 8.0)
    assert np.ptp(car.log[400:]) < 0.2
    assert car.speed == pytest.approx(speed, rel=0.1)


def test_flat_tyre_pulls_to_its_side(rig):
    for wheel, side in ((0, 1.0), (1, -1.0), (2, 1.0), (3, -1.0)):
        car = rig(speed=20.0)
        car.fleet.set_fault(0, wheel, FLAT_TYRE)
        car.drive(2.0, throttle=0.1)
        assert car.position[1] * side > 0.05


def test_split_friction_pulls_to_the_grip(rig):
    car = rig(speed=20.0, friction=(0.9, 0.3, 0.9, 0.3)).drive(1.0, brake=1.0)
    assert car.yaw_rate > 0.02
    assert car.heading > 0.01
    mirrored = rig(speed=20.0, friction=(0.3, 0.9, 0.3, 0.9)).drive(1.0, brake=1.0)
    assert mirrored.heading == pytest.approx(-car.heading)


@pytest.mark.parametrize("model", ["bullet", "dynamic", "kinematic"])
@pytest.mark.parametrize("name", EACH)
def test_top_speed_balances_power_and_resistance(name, model):
    car = vehicle(name)

    def spare(speed):
        resistance = 0.6 * car.drag_area * speed**2 + car.tyre.rolling_resistance * car.mass * GRAVITY
        return car.drive.power - resistance * speed

    low, high = 1.0, 150.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if spare(middle) > 0.0 else (low, middle)
    with Fleet(1, 1) as fleet:
        fleet.spawn(0, name, (0.0, 0.0), 0.0, 0.9 * low, model=model)
        for _ in range(2500):
            fleet.step(np.array([[1.0, 0.0, 0.0]]))
        # Slip takes its share: 0.5% of a car's power, 1.2% of the light motorcycle's.
        assert 0.985 * low < fleet.motion.velocity[0, 0] < 1.001 * low


def test_lateral_load_transfer(rig):
    car = rig(speed=15.0).hold(15.0, 4.0, steering=0.1)
    loads, record = car.fleet.wheels.load[0], vehicle("passenger")
    moved = 0.5 * (loads[1] - loads[0]) * record.front.track + 0.5 * (loads[3] - loads[2]) * record.rear.track
    # The moment of the side force about the road, and of the centre of gravity's shift as the body rolls:
    # with respect to the hubs, one tyre radius above the road, below which the contacts stay.
    x, y, z, w = car.fleet.body(0)[3:7]
    roll = math.asin(2.0 * (y * z + w * x))
    side = car.speed * car.yaw_rate * record.cog_height
    shift = GRAVITY * (record.cog_height - record.tyre.radius) * math.sin(roll)
    assert roll > 0.01
    assert moved == pytest.approx(record.mass * (side + shift), rel=0.01)
    assert loads.sum() == pytest.approx(record.mass * GRAVITY, rel=0.01)


def test_braking_moves_load_forward(rig):
    car = rig(speed=25.0, step=0.01, substeps=1).drive(1.5, brake=0.3)
    loads, record = car.fleet.wheels.load[0], vehicle("passenger")
    moved = loads[:2].sum() - record.mass * GRAVITY * record.cog_to_rear_axle / record.wheelbase
    tyres = -float(car.fleet.wheels.force_x[0].sum())
    assert moved == pytest.approx(tyres * record.cog_height / record.wheelbase, rel=0.03)


def test_steering_turns_at_its_rate_and_stops_at_its_lock(rig):
    steering, car = vehicle("passenger").steering, rig()
    car.drive(1.0, steering=1.0)
    assert car.steering == pytest.approx(steering.rate)
    car.drive(1.0, steering=1.0)
    assert car.steering == pytest.approx(steering.max_angle)
    car.drive(2.5, steering=-0.5)
    assert car.steering == pytest.approx(-0.5 * steering.max_angle)


def test_launch_is_limited_by_the_driven_wheels_grip(rig):
    car, record = rig().drive(1.5, throttle=1.0), vehicle("passenger")
    share, height = record.cog_to_front_axle / record.wheelbase, record.cog_height / record.wheelbase
    # m a = mu (share m g + height m a), and the front wheels' rolling resistance and spin take a little.
    ideal = 0.9 * share * GRAVITY / (1.0 - 0.9 * height)
    assert 0.88 * ideal < car.log[-1] < 1.0 * ideal
    wild = rig()
    wild.fleet.set_assistance(0, abs=True, traction_control=False)
    wild.drive(1.5, throttle=1.0)
    assert wild.fleet.wheels.slip[0, 2:].min() > 0.5
    assert wild.speed < car.speed
