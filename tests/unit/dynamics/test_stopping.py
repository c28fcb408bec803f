"""Full braking on a straight road against v^2 / (2 mu g), and against what tyres and brakes give by hand.

By hand (`by_hand.Car`): every tyre at its largest force, or locked at full slip, under the load that braking
moves; the Magic Formula of the tyre's file; drag. Nothing else: no pitching, no bristle, no wheel spin.
"""

import pytest

from smarts.dynamics import TYRE_MODELS, vehicle
from smarts.dynamics.layout import GRAVITY
from tests.unit.dynamics.by_hand import EACH, FRONT, REAR, Car

SPEED = 20.0
FRICTIONS = (0.9, 0.4)


def ideal(friction):
    return SPEED**2 / (2.0 * friction * GRAVITY)


@pytest.mark.parametrize("tyres", TYRE_MODELS)
@pytest.mark.parametrize("friction", FRICTIONS)
def test_a_car_with_abs_stops_within_3_percent_of_the_ideal(rig, friction, tyres):
    assert rig(speed=SPEED, friction=friction, tyres=tyres).stop() == pytest.approx(ideal(friction), rel=0.03)


@pytest.mark.parametrize(
    ("name", "friction", "late"),
    [
        *(("bus", 0.4, 0.03), ("truck", 0.9, 0.05), ("coach", 0.9, 0.06)),
    ],
)
def test_heavy_vehicles_stop_within_5_percent_of_the_ideal(rig, name, friction, late):
    """But for the coach on a dry road, which its tyres stop 5.3% late with any brakes, see below.

    The friction of the road is what a tyre has at its static load; the truck tyre's file has less of it the
    more the tyre carries, and braking loads the coach's front tyres far beyond their nominal load.
    """
    distance = rig(name, speed=SPEED, friction=friction).stop()
    assert distance == pytest.approx(ideal(friction), rel=late)
    if late > 0.05:
        assert Car(name).stopping_distance(SPEED, friction) > 1.05 * ideal(friction)


@pytest.mark.parametrize("friction", FRICTIONS)
@pytest.mark.parametrize("name", EACH)
def test_stops_with_abs_as_its_tyres_allow(rig, name, friction):
    distance = rig(name, speed=SPEED, friction=friction).stop()
    assert distance == pytest.approx(Car(name).stopping_distance(SPEED, friction), rel=0.01)


@pytest.mark.parametrize("name", EACH)
def test_brakes_can_lock_every_wheel_on_a_dry_road(name):
    """Each as large as the tyre's largest force on a road of 1.0, under the load that braking moves."""
    car, record = Car(name), vehicle(name)
    _, load = car.straight_braking(0.0, 1.0)
    for end, axle in ((FRONT, record.front), (REAR, record.rear)):
        assert axle.brake_torque > car.grip(end, load[end], 1.0, "x") * record.tyre.radius


@pytest.mark.parametrize("friction", FRICTIONS)
@pytest.mark.parametrize("name", EACH)
def test_locked_wheels_slide_as_the_tyres_curve_says(rig, name, friction):
    """Locked from the first moment on. In the last metre the bristle holds more than a sliding tyre."""
    car = rig(name, speed=SPEED, friction=friction)
    car.fleet.set_assistance(0, abs=False, traction_control=False)
    car.fleet._states["spin"] = 0.0
    # The bristle slides already; as if it held, its first pull would turn the wheels.
    car.fleet._states["share_x"] = 0.02
    car.once(0.0, 1.0, 0.0)
    assert (car.fleet.wheels.spin[0] == 0.0).all()
    by_hand = Car(name).stopping_distance(SPEED, friction, locked=True)
    car.stop()
    assert 0.97 * by_hand < car.position[0] < 1.01 * by_hand


@pytest.mark.parametrize(("friction", "share"), [(0.9, 0.70), (0.4, 0.65)])
def test_locked_wheels_stop_a_car_over_40_percent_later(rig, friction, share):
    """Rolling wheels take 0.2 s to lock at 0.9, near their largest force: from there it is 37%."""
    car = Car("passenger")
    kept = [car.sliding_share(end, car.static[end], friction) for end in (FRONT, REAR)]
    assert kept == pytest.approx([share, share], abs=0.01)
    by_hand = car.stopping_distance(SPEED, friction, locked=True) / car.stopping_distance(SPEED, friction)
    assert by_hand > 1.4
    with_abs, without = rig(speed=SPEED, friction=friction), rig(speed=SPEED, friction=friction)
    without.fleet.set_assistance(0, abs=False, traction_control=False)
    assert (1.4 if friction == 0.4 else 1.35) < without.stop() / with_abs.stop() < by_hand
