"""Nothing gains energy that nothing drives: vehicles that coast, brake and steer at random."""

import numpy as np
import pytest

from smarts.dynamics import FLAT_TYRE, TYRE_MODELS, Fleet
from smarts.types.streams import Purpose, stream

TYPES = ("passenger", "bus", "coach", "truck", "motorcycle")
GIVEN_BACK = {"kinematic": 0.0, "dynamic": 2.0, "bullet": 6.0}
"""Most that tyres, springs and spinning wheels may give back to a body [J/kg]; 10 m/s are 50 J/kg."""


def kinetic_energy(fleet):
    """Return the kinetic energy of each vehicle's body, rotation included [J], shape (E,)."""
    cars, bodies = fleet._cars, fleet._bodies
    x, y, z, w = bodies[:, 3:7].T
    axes = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    turning = np.einsum("ije,ei->ej", axes, bodies[:, 10:13])
    return 0.5 * (cars["mass"] * (bodies[:, 7:10] ** 2).sum(1) + (cars["inertia"] * turning**2).sum(1))


def coasting_controls(count, seconds, draw):
    """Yield the same array of throttle, brake and steering (count, 3), changed at random, each 10 ms."""
    controls = np.zeros((count, 3))
    for _ in range(round(seconds / 0.01)):
        changed = draw.random(count) < 0.03
        brake = draw.choice([0.0, 0.0, 0.0, 0.1, 0.5, 1.0], count)
        steering = np.where(
            draw.random(count) < 0.5, draw.choice([-1.0, 0.0, 1.0], count), draw.uniform(-1.0, 1.0, count)
        )
        controls[changed, 1], controls[changed, 2] = brake[changed], steering[changed]
        yield controls


@pytest.mark.parametrize("tyres", TYRE_MODELS)
@pytest.mark.parametrize("model", GIVEN_BACK)
def test_coasting_vehicles_gain_no_energy(model, tyres):
    """All types, forwards and backwards, in spins, with flat tyres, on all frictions."""
    draw, places = stream(0, Purpose.STARTS), 20 if model == "bullet" else 200
    with Fleet(200 // places, places, step=0.01, substeps=1) as fleet:
        for row in range(200):
            where, heading, speed = (0.0, 1000.0 * row), draw.uniform(-3.0, 3.0), draw.uniform(-10.0, 35.0)
            fleet.spawn(row, TYPES[row % 5], where, heading, speed, model=model, tyres=tyres)
            if draw.random() < 0.1:
                fleet.set_fault(row, int(draw.integers(4)), FLAT_TYRE)
        fleet.road.friction[:] = draw.choice([0.05, 0.2, 0.4, 0.7, 0.9, 1.2], (200, 1))
        if model == "dynamic":
            fleet._bodies[:50, 7:9] += draw.uniform(-8.0, 8.0, (50, 2))
            fleet._bodies[:50, 12] = draw.uniform(-3.0, 3.0, 50)
        begin = lowest = kinetic_energy(fleet)
        for controls in coasting_controls(200, 5.0, draw):
            fleet.step(controls)
            now = kinetic_energy(fleet)
            # A NaN fails, too.
            assert (now - lowest <= GIVEN_BACK[model] * fleet._cars["mass"] + 1e-9 * begin).all()
            lowest = np.minimum(lowest, now)


def test_steering_leaves_the_energy_of_a_kinematic_vehicle_that_loses_none():
    count, draw = 200, stream(5, Purpose.STARTS)
    with Fleet(1, count) as fleet:
        for row in range(count):
            speed, angle = draw.uniform(-15.0, 40.0), draw.uniform(-0.5, 0.5)
            fleet.spawn(row, TYPES[row % 5], (0.0, 0.0), 0.0, speed, steering=angle, model="kinematic")
        fleet._cars["rolling_resistance"] = fleet._cars["drag"] = 0.0
        begin = kinetic_energy(fleet)
        for controls in coasting_controls(count, 2.0, draw):
            controls[:, 1] = 0.0
            fleet.step(controls)
            assert kinetic_energy(fleet) == pytest.approx(begin, rel=1e-9)
