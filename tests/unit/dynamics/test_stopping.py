"""Full braking on a straight road against v^2 / (2 mu g), and against what tyres and brakes give by hand.

By hand (`by_hand.Car`): every tyre at its largest force, or locked at full slip, under the load that braking
moves; the Magic Formula of the tyre's file; drag. Nothing else: no pitching, no bristle, no wheel spin.
"""

import pytest

from smarts.dynamics.layout import GRAVITY
from tests.unit.dynamics.by_hand import EACH, Car

SPEED = 20.0
FRICTIONS = (0.9, 0.4)


def ideal(friction):
    return SPEED**2 / (2.0 * friction * GRAVITY)


@pytest.mark.parametrize("friction", FRICTIONS)
@pytest.mark.parametrize("name", EACH)
def test_stops_with_abs_as_its_tyres_allow(rig, name, friction):
    distance = rig(name, speed=SPEED, friction=friction).stop()
    assert distance == pytest.approx(Car(name).stopping_distance(SPEED, friction), rel=0.01)


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
