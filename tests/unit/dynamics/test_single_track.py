import math

import numpy as np
import pytest

from smarts.dynamics import Fleet, vehicle
from smarts.dynamics.layout import GRAVITY, pack
from smarts.types.streams import Purpose, stream
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
def test_kinematic_yaw_rate_is_the_rear_axles_speed_times_tan_steering_over_wheelbase(name):
    record, count, draw = vehicle(name), 50, stream(4, Purpose.STARTS)
    with Fleet(1, count) as fleet:
        for row in range(count):
            speed, angle = draw.uniform(-10.0, 40.0), draw.uniform(-0.5, 0.5)
            fleet.spawn(row, name, (0.0, 0.0), 0.3 * row, speed, steering=angle, model="kinematic")
        for _ in range(100):
            motion = fleet.step(draw.uniform(-1.0, 1.0, (count, 3)))
            speed, aside = motion.velocity.T
            # The rear axle has the body's velocity forward, and none to the side.
            assert aside == pytest.approx(motion.yaw_rate * record.cog_to_rear_axle, rel=1e-9, abs=1e-12)
            expected = speed * np.tan(motion.steering) / record.wheelbase
            assert motion.yaw_rate == pytest.approx(expected, rel=1e-9, abs=1e-12)


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


def test_agrees_with_the_car_in_bullet_in_a_gentle_lane_change():
    with Fleet(1, 2) as fleet:
        fleet.spawn(0, "passenger", (0.0, 0.0), 0.0, 15.0)
        fleet.spawn(1, "passenger", (0.0, 50.0), 0.0, 15.0, model="dynamic")
        for step in range(60):
            steering = 0.04 * math.sin(2.0 * math.pi * min(step / 40.0, 1.0))
            fleet.step(np.array([[0.1, 0.0, steering]] * 2))
        bullet, single = fleet.motion.position
        # The single track has no wheels to spin up, which are 6% of a car's inertia.
        assert single[0] == pytest.approx(bullet[0], abs=0.6)
        assert single[1] - 50.0 == pytest.approx(bullet[1], abs=0.15)
        assert bullet[1] > 1.5


def test_slides_where_grip_ends(rig):
    car = rig(speed=20.0, friction=0.3, model="dynamic").drive(3.0, steering=1.0)
    assert car.speed * car.yaw_rate < 0.3 * GRAVITY * 1.05
    kinematic = rig(speed=20.0, friction=0.3, model="kinematic").drive(3.0, steering=1.0)
    assert kinematic.speed * kinematic.yaw_rate > 3.0 * GRAVITY, "the kinematic one knows no grip sideways"


def test_brakes_never_add_energy():
    """From whatever spin, kinetic energy only falls while nothing drives.

    Sliding tyres give back what their springs hold: force^2 / (2 stiffness), below 1 J per kg of vehicle.
    """
    names, draw = ("passenger", "bus", "truck", "motorcycle", "coach"), stream(3, Purpose.STARTS)
    count = 20 * len(names)

    def energy(fleet):
        bodies, cars = fleet._bodies, fleet._cars
        turning = cars["inertia"][:, 2] * bodies[:, 12] ** 2 / cars["mass"]
        return 0.5 * (bodies[:, 7] ** 2 + bodies[:, 8] ** 2 + turning)

    with Fleet(1, count) as fleet:
        for row in range(count):
            speed = draw.uniform(0.0, 30.0)
            fleet.spawn(row, names[row % 5], (0.0, 50.0 * row), 0.0, speed, model="dynamic")
            fleet._bodies[row, 8] = draw.uniform(-10.0, 10.0)
            fleet._bodies[row, 12] = draw.uniform(-4.0, 4.0)
        fleet.road.friction[:] = draw.choice([0.2, 0.5, 0.9], (count, 1))
        steering = draw.choice([-1.0, 0.0, 0.5, 1.0], count)
        controls = np.stack([np.zeros(count), np.ones(count), steering], axis=1)
        least = energy(fleet)
        for _ in range(300):
            fleet.step(controls)
            assert (energy(fleet) <= least + 1.0).all()
            least = np.minimum(least, energy(fleet))
        assert (energy(fleet) < 0.01).all()
