"""Where the time of a step goes.

    python -m perf.step --scenario intersection --worlds 1 8 --steps 500

Egos keep their lane at the benchmark's interface, in Bullet; worlds whose egos are done are reset at once,
which is left out of the time. The stages are wrapped in clocks from outside; the product has none. Compare
numbers of one run only.
"""

from __future__ import annotations

import argparse
import dataclasses
import time
from collections import defaultdict
from typing import Any

import numpy as np

from smarts.env.adapters.benchmark import benchmark_interface
from smarts.sim.assembly import assemble
from smarts.sim.simulation import Simulation
from smarts.sstudio.build import build_scenario
from smarts.types.vehicles import Owner


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
    parts = assemble([build_scenario(name)], [benchmark_interface()] * egos, worlds=worlds)
    simulation, spent = clocked(parts.simulation)
    actions = parts.actions
    actions.given[:, :egos] = True
    actions.values[...] = 0.0  # keep_lane
    episodes = dict.fromkeys(range(worlds), 0)
    frame = simulation.reset({row: parts.schedule.start(row, 0) for row in episodes})
    rows, wanted = np.ones(worlds, np.bool_), np.zeros((worlds, egos), np.bool_)
    whole, others, driving = 0.0, 0, 0
    for step in range(20 + steps):
        if step == 20:
            spent.clear()
            whole, others, driving = 0.0, 0, 0
        wanted[...] = step % 5 == 4  # observed once a decision
        begin = time.perf_counter()
        frame = simulation.step(actions, rows, wanted)
        whole += time.perf_counter() - begin
        vehicles = simulation.world.vehicles
        driving += int((vehicles.owner == Owner.AGENT).sum())
        others += int(vehicles.alive.sum() - (vehicles.owner == Owner.AGENT).sum())
        if finished := np.flatnonzero(frame.events.finished).tolist():
            before = dict(spent)
            for row in finished:
                episodes[row] += 1
            simulation.reset({row: parts.schedule.start(row, episodes[row]) for row in finished})
            spent.clear()
            spent.update(before)
    parts.simulation.close()
    each = 1e6 / (steps * worlds)
    print(
        f"{name}, B = {worlds}: {driving / steps / worlds:.1f} egos and {others / steps / worlds:.1f} others"
        " on average"
    )
    for stage, seconds in sorted(spent.items(), key=lambda item: -item[1]):
        print(f"  {stage:24} {seconds * each:8.1f} us")
    print(f"  {'everything else':24} {(whole - sum(spent.values())) * each:8.1f} us")
    print(f"  {'step':24} {whole * each:8.1f} us = {1e6 / (whole * each):.0f} env-steps/s")


def main() -> None:
    """Measure what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", default="intersection")
    parser.add_argument("--worlds", type=int, nargs="+", default=[1, 8])
    parser.add_argument("--egos", type=int, default=4)
    parser.add_argument("--steps", type=int, default=500)
    options = parser.parse_args()
    for worlds in options.worlds:
        measure(options.scenario, worlds, options.egos, options.steps)


if __name__ == "__main__":
    main()
