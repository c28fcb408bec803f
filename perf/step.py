"""Where the time of a step goes.

    python -m perf.step --scenario intersection --worlds 1 4 --steps 500

The stages are wrapped in clocks from outside; the product has none. Compare numbers of one run only.
"""

from __future__ import annotations

import argparse
import dataclasses
import time
from collections import defaultdict
from typing import Any

import numpy as np

from smarts.sim.simulation import Simulation
from smarts.sstudio.build import build_scenario
from tests.parts import episode, simulation_of


class Clock:
    """A part of the simulation whose calls are timed."""

    def __init__(self, part: Any, name: str, spent: dict[str, float]) -> None:
        self._part = part
        self._name = name
        self._spent = spent

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._part, name)
        if not callable(value):
            return value

        def timed(*arguments: Any) -> Any:
            begin = time.perf_counter()
            result = value(*arguments)
            self._spent[f"{self._name}.{name}"] += time.perf_counter() - begin
            return result

        setattr(self, name, timed)
        return timed


def clocked(simulation: Simulation) -> tuple[Simulation, dict[str, float]]:
    """Return a simulation with the same parts whose time is taken, and the seconds spent so far."""
    spent: dict[str, float] = defaultdict(float)
    stages = simulation._stages
    clocks = {
        field.name: Clock(getattr(stages, field.name), field.name, spent)
        for field in dataclasses.fields(stages)
    }
    return Simulation(simulation.world, dataclasses.replace(stages, **clocks)), spent


def measure(name: str, worlds: int, egos: int, steps: int) -> None:
    """Print microseconds for each step of one simulation, stage by stage."""
    scenarios = [build_scenario(name)]
    plain, actions = simulation_of(scenarios, worlds=worlds, egos=egos)
    simulation, spent = clocked(plain)
    simulation.reset({row: episode(scenarios, 0, egos=egos, world=row) for row in range(worlds)})
    rows, wanted = np.ones(worlds, np.bool_), np.ones((worlds, egos), np.bool_)
    actions.values[:, :, 0] = 0.1
    for _ in range(20):
        simulation.step(actions, rows, wanted)
    spent.clear()
    begin = time.perf_counter()
    for _ in range(steps):
        simulation.step(actions, rows, wanted)
    whole = time.perf_counter() - begin
    alive = simulation.world.vehicles.alive.sum() / worlds
    plain.close()
    each = 1e6 / (steps * worlds)
    print(f"{name}, B = {worlds}, {egos} egos, {alive - egos:.0f} others at the end:")
    for stage, seconds in sorted(spent.items(), key=lambda item: -item[1]):
        print(f"  {stage:24} {seconds * each:8.1f} us")
    print(f"  {'everything else':24} {(whole - sum(spent.values())) * each:8.1f} us")
    print(f"  {'step':24} {whole * each:8.1f} us = {1e6 / (whole * each):.0f} env-steps/s")


def main() -> None:
    """Measure what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", default="intersection")
    parser.add_argument("--worlds", type=int, nargs="+", default=[1, 4])
    parser.add_argument("--egos", type=int, default=4)
    parser.add_argument("--steps", type=int, default=500)
    options = parser.parse_args()
    for worlds in options.worlds:
        measure(options.scenario, worlds, options.egos, options.steps)


if __name__ == "__main__":
    main()
