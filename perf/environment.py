"""Processor time of the whole environment, by how many simulations are side by side.

    python -m perf.environment                                 # Native and SUMO, as training uses them
    python -m perf.environment --worlds 256 --only native --stages

One process on one core. The environment is `VectorHiWayEnv` with four agents at intersection_v1 among random
traffic, the observation `neighbor_rows` and the reward `v1`, a decision of five steps of 0.1 s. Agents keep
their lanes, nine times in ten; else they do one of the actions that their masks allow. Prints microseconds
for a decision of one simulation, without resets; milliseconds for a reset; the resets that occurred included;
and, with `--stages`, microseconds of each stage for a decision.
"""

from __future__ import annotations

import argparse
import dataclasses
import time
from collections import defaultdict
from collections.abc import Callable
from typing import Any

import numpy as np

from smarts.agents.benchmark import benchmark_interface
from smarts.env.vector import VectorHiWayEnv
from smarts.sim.options import Options
from smarts.types.vehicles import Owner

AGENTS = 4
ENGINES = {
    "native": ("Native", "kinematic"),
    "sumo": ("SUMO", "kinematic"),
    "bullet": ("SUMO", "bullet"),
}
MOST_SUMO = 8
"""Most simulations that are measured with SUMO."""
WARM_UP = 40
"""Decisions before the first that is timed, so that simulations are in all stages of an episode."""
SHOWN = 0.2
"""Least time of a stage that is printed [us]."""
KEEPING = 0.9
"""Share of decisions to keep the lane."""


class Clocks:
    """Processor time by part [s]."""

    def __init__(self) -> None:
        self.own: dict[str, float] = defaultdict(float)
        """Without the parts within it."""
        self.whole: dict[str, float] = defaultdict(float)
        self._inner = 0.0

    def timed(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function whose calls are timed."""

        def call(*arguments: Any, **named: Any) -> Any:
            outer, self._inner = self._inner, 0.0
            begin = time.process_time()
            try:
                return function(*arguments, **named)
            finally:
                spent = time.process_time() - begin
                self.own[name] += spent - self._inner
                self.whole[name] += spent
                self._inner = outer + spent

        return call

    def clear(self) -> None:
        """Begin again."""
        self.own.clear()
        self.whole.clear()


def environment(worlds: int, engine: str, model: str, scenario: str) -> VectorHiWayEnv:
    """Return the environment that is measured."""
    interface: Any = benchmark_interface(vehicle_model=model)
    return VectorHiWayEnv(
        worlds,
        [scenario],
        {f"agent-{number}": interface for number in range(AGENTS)},
        observation="neighbor_rows",
        reward="v1",
        traffic=["random_social_vehicles"],
        simulation=Options(traffic_engine=engine),
    )


def watch(env: VectorHiWayEnv, clocks: Clocks) -> None:
    """Time the stages of an environment."""
    simulation = env._runner.simulation
    stages: Any = simulation._stages
    methods = {
        "ownership": ("apply", "drop_vanished", "note_collisions", "submit", "clear"),
        "entries": ("enter", "reset", "clear_way"),
        "controllers": ("command",),
        "vehicles": ("step", "reset"),
        "traffic": ("step", "reset"),
        "contacts": ("find",),
        "events": ("detect", "reset"),
        "transfer_rules": ("propose", "clear"),
        "sensors": ("observe",),
        "bubbles": ("place", "propose", "begin"),
    }
    for name, watched in methods.items():
        part = getattr(stages, name)
        for method in watched:
            object.__setattr__(part, method, clocks.timed(f"{name}.{method}", getattr(part, method)))
    matcher = stages.matcher
    names = "match", "turn signals", "manoeuvres", "action masks"
    matcher._parts = tuple(
        clocks.timed(f"matcher: {n}", each) for n, each in zip(names, matcher._parts, strict=True)
    )
    for group in env._groups:
        adapter: Any = group.adapter
        adapter._rewards.collect = clocks.timed("rewards", adapter._rewards.collect)
        for each in adapter._observed:
            each.observe = clocks.timed("observations", each.observe)


@dataclasses.dataclass
class Result:
    """A line of the table, per decision of a simulation [us]."""

    step: float
    reset: float
    """[ms]"""
    whole: float
    vehicles: float
    """Vehicles of traffic in a simulation, mean."""
    stages: dict[str, float]


def measure(worlds: int, engine: str, model: str, scenario: str, decisions: int, in_stages: bool) -> Result:
    """Drive an environment, and return what a decision costs."""
    env, clocks, draws = environment(worlds, engine, model, scenario), Clocks(), np.random.default_rng(7)
    if in_stages:
        watch(env, clocks)
    env._next_episodes = clocks.timed("resets", env._next_episodes)
    step, begin, resets, vehicles = env.reset(), 0.0, 0, 0
    for decision in range(WARM_UP + decisions):
        if decision == WARM_UP:
            clocks.clear()
            begin, resets, vehicles = time.process_time(), 0, 0
        mask: Any = step.masks[0]
        drawn = (draws.random(mask.shape) * mask).argmax(axis=-1)
        step = env.step([np.where(draws.random(drawn.shape) < KEEPING, 0, drawn)])
        resets += np.count_nonzero(step.reset)
        vehicles += np.count_nonzero(env._runner.world.vehicles.owner == Owner.TRAFFIC)
    spent, each = time.process_time() - begin, 1e6 / (decisions * worlds)
    env.close()
    return Result(
        (spent - clocks.whole["resets"]) * each,
        clocks.whole["resets"] / max(resets, 1) * 1e3,
        spent * each,
        vehicles / (decisions * worlds),
        {name: time * each for name, time in clocks.own.items()},
    )


def main() -> None:
    """Measure what the command line asks for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--worlds", nargs="+", type=int, default=[1, 8, 64, 256, 1024])
    parser.add_argument("--only", nargs="+", choices=[*ENGINES], default=[*ENGINES])
    parser.add_argument("--scenario", default="intersection_v1")
    parser.add_argument("--decisions", type=int, default=20_000, help="of all simulations, at least 40 each")
    parser.add_argument("--stages", action="store_true")
    options = parser.parse_args()
    print(f"{'':24}{'B':>6}{'us a decision':>15}{'ms a reset':>12}{'with resets':>13}{'vehicles':>10}")
    for name in options.only:
        for worlds in options.worlds:
            if ENGINES[name][0] == "SUMO" and worlds > MOST_SUMO:
                continue
            decisions = max(40, options.decisions // worlds)
            found = measure(worlds, *ENGINES[name], options.scenario, decisions, options.stages)
            label = " and ".join(ENGINES[name])
            print(
                f"{label:24}{worlds:6}{found.step:15.1f}{found.reset:12.2f}{found.whole:13.1f}{found.vehicles:10.1f}",
                flush=True,
            )
            for stage, each in sorted(found.stages.items(), key=lambda item: -item[1]):
                if options.stages and each >= SHOWN:
                    print(f"    {stage:32}{each:10.1f}", flush=True)


if __name__ == "__main__":
    main()
