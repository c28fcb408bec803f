"""Speed of vehicle dynamics beside the bare Bullet calls that it cannot do without, in one run.

python perf/dynamics.py [--seconds 2]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
import pybullet

from smarts.dynamics import Box, Fleet

CARS, SUBSTEPS, DT = 4, 10, 0.01
BATCH = 8
ROWS = 64
"""Single-track vehicles in one call."""


def best_of(seconds: float, *tasks: Callable[[], object]) -> list[float]:
    """Return each task's shortest time [s]; the tasks take turns, so that all see the same machine."""
    times = [[] for _ in tasks]
    for task in tasks:
        task()
    end = time.perf_counter() + seconds
    while time.perf_counter() < end:
        for task, measured in zip(tasks, times, strict=True):
            begin = time.perf_counter()
            task()
            measured.append(time.perf_counter() - begin)
    return [min(measured) for measured in times]


def bare_loop() -> Callable[[], None]:
    """Return one step of four cars in Bullet: every call that ours makes, and nothing else."""
    client = pybullet.connect(pybullet.DIRECT)
    pybullet.setTimeStep(DT, client)
    shape = pybullet.createCollisionShape(
        pybullet.GEOM_BOX, halfExtents=[2.2, 0.8, 0.6], physicsClientId=client
    )
    bodies = [
        pybullet.createMultiBody(1100.0, shape, -1, [0.0, 10.0 * car, 1.0], physicsClientId=client)
        for car in range(CARS)
    ]
    for body in bodies:
        pybullet.changeDynamics(body, -1, linearDamping=0.0, angularDamping=0.0, physicsClientId=client)
    linear, angular = [20.0, 0.0, 0.0], [0.0, 0.0, 0.1]

    def step() -> None:
        for _ in range(SUBSTEPS):
            for body in bodies:
                pybullet.resetBaseVelocity(body, linear, angular, client)
            pybullet.stepSimulation(client)
            for body in bodies:
                pybullet.getBasePositionAndOrientation(body, client)
                pybullet.getBaseVelocity(body, client)

    return step


def cruising(simulations: int, egos: int, model: str) -> tuple[Fleet, np.ndarray]:
    """Return vehicles at 20 m/s in a gentle bend, and their controls."""
    fleet = Fleet(simulations, egos, SUBSTEPS * DT, SUBSTEPS)
    for row in range(simulations * egos):
        fleet.spawn(row, "passenger", (0.0, 10.0 * row), 0.0, 20.0, model=model)
    return fleet, np.tile([0.15, 0.0, 0.02], (simulations * egos, 1))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=2.0, help="for each comparison")
    seconds = parser.parse_args().seconds

    alone, controls = cruising(1, CARS, "bullet")
    batch, batch_controls = cruising(BATCH, CARS, "bullet")
    boxed, _ = cruising(1, CARS, "bullet")
    boxes = {key: Box((300.0 + 8.0 * key, -50.0, 1.0), 0.0, 10.0, 4.5, 1.8, 1.5) for key in range(4)}

    def step_beside_boxes() -> None:
        boxed.place_boxes(0, boxes)
        boxed.step(controls)

    bare, ours, ours_boxed, ours_batch = best_of(
        seconds,
        bare_loop(),
        lambda: alone.step(controls),
        step_beside_boxes,
        lambda: batch.step(batch_controls),
    )
    print(f"{CARS} cars, {SUBSTEPS} sub-steps            ms   of the bare calls")
    print(f"bare Bullet calls             {bare * 1e3:6.3f}   1.00")
    print(f"ours, 1 simulation            {ours * 1e3:6.3f}   {ours / bare:.2f}")
    print(f"ours, in Bullet with 4 boxes  {ours_boxed * 1e3:6.3f}   {ours_boxed / bare:.2f}")
    per_simulation = ours_batch / BATCH
    print(f"ours, one of {BATCH} simulations    {per_simulation * 1e3:6.3f}   {per_simulation / bare:.2f}")

    for model in ("dynamic", "kinematic"):
        fleet, rows = cruising(1, ROWS, model)
        (step,) = best_of(seconds / 4, lambda fleet=fleet, rows=rows: fleet.step(rows))
        print(f"{model} single track: {step / ROWS * 1e6:.2f} us a car-step, {ROWS} in one call")
        fleet.close()

    def reset() -> None:
        alone.clear(0)
        for row in range(CARS):
            alone.spawn(row, "passenger", (0.0, 10.0 * row), 0.0, 20.0)

    (cleared,) = best_of(seconds / 4, reset)
    print(f"clear a simulation and spawn {CARS} cars: {cleared * 1e3:.2f} ms")


if __name__ == "__main__":
    main()
