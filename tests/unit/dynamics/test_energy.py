"""Nothing gains energy that nothing drives; `python perf/energy.py` plays 10,000 sequences of each model."""

import numpy as np
import pytest

from perf import energy
from smarts.dynamics import TYRE_MODELS, Fleet, vehicle
from smarts.types.streams import Purpose, stream

MANY = [("kinematic", 2000), ("dynamic", 2000), ("bullet", 1000)]


@pytest.mark.parametrize(
    ("model", "sequences", "tyres"),
    [
        *((model, 200, "pacejka") for model, _ in MANY),
        *(pytest.param(*each, tyres, marks=pytest.mark.nightly) for each in MANY for tyres in TYRE_MODELS),
    ],
)
def test_coasting_vehicles_gain_no_energy(model, sequences, tyres):
    """10,000 random sequences of brake and steering, over all nightly cases."""
    gain = energy.coast(model, sequences, 5.0, tyres)
    assert set(gain.kind) == set(energy.TYPES)
    assert not gain.breaches.any(), np.flatnonzero(gain.breaches)
    if model == "kinematic":
        assert (gain.regained <= 1e-9 * gain.start).all()


def test_energies_that_a_page_of_paper_gives():
    record = vehicle("passenger")
    with Fleet(1, 2) as fleet:
        fleet.spawn(0, "passenger", (0.0, 0.0), 1.0, 8.0)
        fleet.spawn(1, "passenger", (0.0, 9.0), 1.0, 8.0, steering=0.3, model="kinematic")
        rate = 8.0 * np.tan(0.3) / record.wheelbase
        aside = record.cog_to_rear_axle * rate
        straight, turning = energy.kinetic_energy(fleet)
        assert straight == pytest.approx(0.5 * record.mass * 64.0)
        expected = record.mass * (64.0 + aside**2) + record.inertia[2] * rate**2
        assert turning == pytest.approx(0.5 * expected)
        # A settled car holds nothing in its springs; raised by 2 cm, it holds what lifting took.
        assert energy.suspension_energy(fleet)[0] == pytest.approx(0.0, abs=1e-6)
        fleet._bodies[0, 2] += 0.02
        stiffness = fleet._cars["spring"][0].sum()
        assert energy.suspension_energy(fleet)[0] == pytest.approx(0.5 * stiffness * 0.02**2)
        spinning = (
            2.0 * (record.front.wheel_inertia + record.rear.wheel_inertia) * (8.0 / record.tyre.radius) ** 2
        )
        held = energy.stored_energy(fleet, "bullet")[0] - energy.suspension_energy(fleet)[0]
        assert held == pytest.approx(0.5 * spinning)
        fleet._states["deflection_y"][0, 2] = 0.001
        pulled = energy.stored_energy(fleet, "bullet")[0] - energy.suspension_energy(fleet)[0] - held
        assert pulled == pytest.approx(0.5 * fleet._cars["carcass_y"][0, 2] * 0.001**2)


def test_steering_leaves_the_energy_of_a_kinematic_vehicle_that_loses_none():
    count, draw = 200, stream(5, Purpose.STARTS)
    with Fleet(1, count) as fleet:
        for row in range(count):
            name, speed = energy.TYPES[row % 5], draw.uniform(-15.0, 40.0)
            angle = draw.uniform(-0.5, 0.5)
            fleet.spawn(row, name, (0.0, 0.0), 0.0, speed, steering=angle, model="kinematic")
        fleet._cars["rolling_resistance"] = fleet._cars["drag"] = 0.0
        begin = energy.kinetic_energy(fleet)
        for controls in energy.coasting_controls(count, 2.0, draw):
            controls[:, 1] = 0.0
            fleet.step(controls)
            assert energy.kinetic_energy(fleet) == pytest.approx(begin, rel=1e-9)


def test_a_car_that_coasts_on_full_lock_gets_slower(rig):
    """It went from 10 to over 270 m/s once."""
    for direction in (1.0, -1.0):
        car = rig(speed=10.0, model="kinematic")
        previous = 10.0
        for _ in range(30):
            car.once(0.0, 0.0, direction)
            assert 0.0 < car.speed < previous
            previous = car.speed
        assert car.speed > 8.0
