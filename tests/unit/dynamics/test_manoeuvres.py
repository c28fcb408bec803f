"""Golden manoeuvres; `python tests/unit/dynamics/test_manoeuvres.py` renews them."""

import math
from pathlib import Path

import numpy as np
import pytest

from smarts.dynamics import Fleet, vehicle

GOLDEN = Path(__file__).with_name("manoeuvres.npz")
DT = 0.01
RECORD_EVERY = 5
"""Sub-steps between two rows of the record."""
SPEED = 22.0
"""Speed at every manoeuvre's start [m/s]."""
CAR = vehicle("passenger")


def hold_speed(fleet):
    """Return the throttle that keeps the speed."""
    return float(np.clip(0.06 + 0.3 * (SPEED - fleet.motion.velocity[0, 0]), 0.0, 1.0))


def step_steer(time, fleet):
    """Turn the wheels by 0.03 rad at once and hold them (after ISO 7401)."""
    return hold_speed(fleet), 0.0, 0.03 if time >= 0.5 else 0.0


def sine_with_dwell(time, fleet):
    """Steer one sine of 0.7 Hz that rests at its second peak for half a second (after FMVSS 126)."""
    phase = 2.0 * math.pi * 0.7 * (time - 0.5)
    if phase < 0.0:
        return 0.0, 0.0, 0.0
    if phase > 1.5 * math.pi:
        phase = max(1.5 * math.pi, phase - 2.0 * math.pi * 0.7 * 0.5)
    return 0.0, 0.0, 0.045 * math.sin(phase) if phase < 2.0 * math.pi else 0.0


def brake_in_a_turn(time, fleet):
    """Settle on a bend at 4 m/s^2, then brake hard with the steering held (after ISO 7975)."""
    if time < 3.0:
        return hold_speed(fleet), 0.0, 0.03
    return 0.0, 0.6, 0.03


def split_friction(time, fleet):
    """Brake with all force, 0.9 on the left and 0.3 on the right, steering against the pull."""
    if time < 0.5:
        return 0.0, 0.0, 0.0
    if fleet.motion.velocity[0, 0] < 1.0:
        return 0.0, 1.0, 0.0
    heading, yaw_rate = fleet.motion.heading[0], fleet.motion.yaw_rate[0]
    return 0.0, 1.0, float(-0.8 * heading - 0.3 * yaw_rate)


MANOEUVRES = {
    "step steer": (step_steer, 4.0),
    "sine with dwell": (sine_with_dwell, 4.0),
    "brake in a turn": (brake_in_a_turn, 6.5),
    "split friction": (split_friction, 6.0),
}
"""Driver and duration [s] by name."""
COLUMNS = ("time", "steering", "speed", "lateral", "yaw_rate", "x", "y")


def drive(name):
    """Return the record of a manoeuvre: one array per column, and spin, slip, load of shape (T, 4)."""
    driver, seconds = MANOEUVRES[name]
    rows = []
    with Fleet(1, 1, step=DT, substeps=1) as fleet:
        fleet.spawn(0, "passenger", (0.0, 0.0), 0.0, SPEED)
        if name == "split friction":
            fleet.road.friction[0] = 0.9, 0.3, 0.9, 0.3
        for step in range(round(seconds / DT)):
            throttle, brake, angle = driver(step * DT, fleet)
            motion = fleet.step(np.array([[throttle, brake, angle / CAR.steering.max_angle]]))
            if (step + 1) % RECORD_EVERY == 0:
                planar = (motion.steering[0], motion.velocity[0, 0], motion.acceleration[0, 1])
                wheels = (fleet.wheels.spin[0], fleet.wheels.slip[0], fleet.wheels.load[0])
                rows.append(
                    np.concatenate(
                        [[(step + 1) * DT, *planar, motion.yaw_rate[0], *motion.position[0]], *wheels]
                    )
                )
    table = np.array(rows)
    record = {column: table[:, number] for number, column in enumerate(COLUMNS)}
    for number, column in enumerate(("spin", "slip", "load")):
        first = len(COLUMNS) + 4 * number
        record[column] = table[:, first : first + 4]
    return record


TOLERANCE = {
    "time": 1e-6,
    "steering": 1e-3,
    "speed": 0.02,
    "lateral": 0.05,
    "yaw_rate": 5e-3,
    "x": 0.05,
    "y": 0.05,
    "spin": 0.2,
    "slip": 5e-3,
    "load": 30.0,
}


@pytest.mark.parametrize("name", MANOEUVRES)
def test_manoeuvre_goes_as_recorded(name):
    golden = np.load(GOLDEN)
    record = drive(name)
    assert set(record) == set(TOLERANCE)
    for column, values in record.items():
        assert values == pytest.approx(golden[f"{name}/{column}"], abs=TOLERANCE[column]), column


if __name__ == "__main__":
    np.savez_compressed(
        GOLDEN,
        **{
            f"{name}/{column}": values.astype(np.float32)
            for name in MANOEUVRES
            for column, values in drive(name).items()
        },
    )
