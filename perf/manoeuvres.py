"""Record four golden manoeuvres of the passenger car, and draw them.

    python perf/manoeuvres.py --record tests/unit/dynamics/manoeuvres.npz --plot docs/dynamics.png

The record holds, every 50 ms: steering, speed, lateral acceleration, yaw rate, position, and each wheel's
spin, slip and load. `tests/unit/dynamics/test_manoeuvres.py` drives them again and compares.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from smarts.dynamics import Fleet, vehicle

DT = 0.01
RECORD_EVERY = 5
"""Sub-steps between two rows of the record."""
SPEED = 22.0
"""Of every manoeuvre's start [m/s]."""
CAR = vehicle("passenger")

Driver = Callable[[float, "Fleet"], tuple[float, float, float]]
"""Throttle, brake and steering angle [rad] at a time [s]."""


def hold_speed(fleet: Fleet) -> float:
    """Return the throttle that keeps the speed."""
    return float(np.clip(0.06 + 0.3 * (SPEED - fleet.motion.velocity[0, 0]), 0.0, 1.0))


def step_steer(time: float, fleet: Fleet) -> tuple[float, float, float]:
    """Turn the wheels by 0.03 rad at once and hold them (after ISO 7401)."""
    return hold_speed(fleet), 0.0, 0.03 if time >= 0.5 else 0.0


def sine_with_dwell(time: float, fleet: Fleet) -> tuple[float, float, float]:
    """Steer one sine of 0.7 Hz that rests at its second peak for half a second (after FMVSS 126)."""
    phase = 2.0 * math.pi * 0.7 * (time - 0.5)
    if phase < 0.0:
        return 0.0, 0.0, 0.0
    if phase > 1.5 * math.pi:
        phase = max(1.5 * math.pi, phase - 2.0 * math.pi * 0.7 * 0.5)
    return 0.0, 0.0, 0.045 * math.sin(phase) if phase < 2.0 * math.pi else 0.0


def brake_in_a_turn(time: float, fleet: Fleet) -> tuple[float, float, float]:
    """Settle on a bend at 4 m/s^2, then brake hard with the steering held (after ISO 7975)."""
    if time < 3.0:
        return hold_speed(fleet), 0.0, 0.03
    return 0.0, 0.6, 0.03


def split_friction(time: float, fleet: Fleet) -> tuple[float, float, float]:
    """Brake with all force, 0.9 on the left and 0.3 on the right, steering against the pull."""
    if time < 0.5:
        return 0.0, 0.0, 0.0
    if fleet.motion.velocity[0, 0] < 1.0:
        return 0.0, 1.0, 0.0
    heading, yaw_rate = fleet.motion.heading[0], fleet.motion.yaw_rate[0]
    return 0.0, 1.0, float(-0.8 * heading - 0.3 * yaw_rate)


MANOEUVRES: dict[str, tuple[Driver, float]] = {
    "step steer": (step_steer, 4.0),
    "sine with dwell": (sine_with_dwell, 4.0),
    "brake in a turn": (brake_in_a_turn, 6.5),
    "split friction": (split_friction, 6.0),
}
"""Driver and duration [s] by name."""
COLUMNS = ("time", "steering", "speed", "lateral", "yaw_rate", "x", "y")


def drive(name: str) -> dict[str, NDArray[np.float64]]:
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


def plot(records: dict[str, dict[str, NDArray[np.float64]]], out: Path) -> None:
    """Draw the records, one column each."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(14.0, 11.0), layout="constrained")
    axes = figure.subplots(6, len(records), sharex="col")
    names = ("front left", "front right", "rear left", "rear right")
    for column, (name, record) in enumerate(records.items()):
        time = record["time"]
        rows = axes[:, column]
        rows[0].set_title(name)
        rows[0].plot(time, np.degrees(record["steering"]), "k")
        rows[1].plot(time, record["speed"], "k")
        rows[2].plot(time, record["lateral"], "k", label="lateral acceleration [m/s²]")
        rows[2].plot(time, 10.0 * record["yaw_rate"], "C3--", label="yaw rate [0.1 rad/s]")
        for wheel, label in enumerate(names):
            style = {"color": f"C{wheel}", "label": label, "linewidth": 1.2}
            rows[3].plot(time, record["spin"][:, wheel] * CAR.tyre.radius, **style)
            rows[4].plot(time, 100.0 * record["slip"][:, wheel], **style)
            rows[5].plot(time, record["load"][:, wheel] / 1e3, **style)
        rows[5].set_xlabel("time [s]")
        for axis in rows:
            axis.grid(alpha=0.3)
    labels = ("steering [°]", "speed [m/s]", "", "wheel speed [m/s]", "slip [%]", "load [kN]")
    for axis, label in zip(axes[:, 0], labels, strict=True):
        axis.set_ylabel(label)
    axes[2, 0].legend(fontsize=8, loc="lower right")
    axes[5, 0].legend(fontsize=8, ncols=2, loc="center right")
    figure.savefig(out, dpi=90)


def main() -> None:
    """Record, and write what was asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--record", type=Path, help="write the record here (.npz)")
    parser.add_argument("--plot", type=Path, help="write the picture here (.png)")
    arguments = parser.parse_args()
    records = {name: drive(name) for name in MANOEUVRES}
    if arguments.record:
        flat = {
            f"{name}/{column}": values.astype(np.float32)
            for name, record in records.items()
            for column, values in record.items()
        }
        np.savez_compressed(arguments.record, allow_pickle=False, **flat)
    if arguments.plot:
        plot(records, arguments.plot)
    for name, record in records.items():
        print(
            f"{name}: {record['speed'][-1]:.2f} m/s at ({record['x'][-1]:.2f}, {record['y'][-1]:.2f}), "
            f"largest lateral acceleration {np.abs(record['lateral']).max():.2f} m/s^2"
        )


if __name__ == "__main__":
    main()
