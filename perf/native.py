"""Native traffic beside SUMO's: time, and what the traffic looks like.

    python perf/native.py [--scenarios intersection_v1 two_way_v1 double_merge_v1] [--seeds 5] [--seconds 300]
    python perf/native.py --time [--worlds 1 8 64]

Without `--time`: for each scenario the traffic without agents, with both engines and as many seeds: vehicles,
mean speed, share that stands, arrivals an hour in all and by route, overlapping pairs. With `--time`:
processor time of a decision (five steps) of one simulation, and of a reset, by how many there are.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from smarts.geometry.boxes import boxes_overlap
from smarts.providers.traffic_engines import traffic_of
from smarts.sim import traffic_run
from smarts.sstudio.build import build_scenario
from smarts.types.episode import EpisodeStart
from smarts.types.streams import traffic_seed
from smarts.types.vehicles import VehicleStates
from smarts.types.world import World

SCENARIOS = ("intersection_v1", "two_way_v1", "double_merge_v1")
TRAFFIC = "random_social_vehicles"
ENGINES = ("SUMO", "Native")
CAPACITY, STEPS, SAMPLED, NEAR = 640, 5, 5, 7.0
"""Slots; steps of a decision; steps between samples; vehicles farther apart do not overlap [m]."""


@dataclass
class Statistics:
    """The statistics of one engine's traffic."""

    vehicles: list[int] = field(default_factory=list)
    speed: list[float] = field(default_factory=list)
    standing: list[float] = field(default_factory=list)
    arrived: Counter = field(default_factory=Counter)
    overlapping: set[tuple[int, ...]] = field(default_factory=set)
    hours: float = 0.0


def observe(name: str, engine: str, seeds: int, seconds: float) -> Statistics:
    """Return statistics of a scenario's traffic without agents."""
    built, found = build_scenario(name), Statistics(hours=seeds * seconds / 3600.0)
    traffic_run.CAPACITY = CAPACITY
    edges = built.roads().edge_ids
    for seed in range(seeds):
        with traffic_run.traffic_run(built, TRAFFIC, seed=seed, engine=engine) as run:
            routes: dict[tuple[int, int], int] = {}
            for step, states in enumerate(run.steps(seconds)):
                alive = np.flatnonzero(states.alive)
                now = {
                    (slot, int(states.generation[slot])): int(states.route[slot]) for slot in alive.tolist()
                }
                for vehicle in routes.keys() - now.keys():
                    way = run.world.routes.edges(0, routes[vehicle]) if routes[vehicle] >= 0 else []
                    found.arrived[f"{edges[way[0]]} to {edges[way[-1]]}" if len(way) else "?"] += 1
                # A vehicle's first route counts: SUMO's is what is left of it.
                routes = {vehicle: routes.get(vehicle, route) for vehicle, route in now.items()}
                if step % SAMPLED == 0 and len(alive):
                    found.vehicles.append(len(alive))
                    found.speed.append(float(states.speed[alive].mean()))
                    found.standing.append(float((states.speed[alive] < 0.1).mean()))
                    found.overlapping |= {(seed, *pair) for pair in overlaps(states, alive)}
    return found


def overlaps(states: VehicleStates, alive: np.ndarray) -> set[tuple[int, ...]]:
    """Return the pairs of vehicles that overlap, each as slots and generations."""
    position = states.position[alive]
    gap = np.hypot(*(position[:, None] - position[None]).transpose(2, 0, 1))
    found = set()
    for i, j in np.argwhere(np.triu(gap < NEAR, 1)).tolist():
        first, second = alive[i], alive[j]
        boxes = [
            (states.position[each], states.heading[each], np.array([states.length[each], states.width[each]]))
            for each in (first, second)
        ]
        if boxes_overlap(*boxes[0], *boxes[1]):
            generations = int(states.generation[first]), int(states.generation[second])
            found.add((int(first), int(second), *generations))
    return found


def compare(name: str, seeds: int, seconds: float) -> None:
    """Print both engines' statistics of a scenario."""
    both = [observe(name, engine, seeds, seconds) for engine in ENGINES]
    print(f"\n{name}, {seeds} seeds of {seconds:g} s")
    print(f"{'':32}{ENGINES[0]:>10}{ENGINES[1]:>10}")
    rows = [
        ("vehicles", [np.mean(each.vehicles) for each in both]),
        ("speed [m/s]", [np.mean(each.speed) for each in both]),
        ("share that stands", [np.mean(each.standing) for each in both]),
        ("arrivals an hour", [each.arrived.total() / each.hours for each in both]),
        ("overlapping pairs an hour", [len(each.overlapping) / each.hours for each in both]),
    ]
    for way in sorted(both[0].arrived | both[1].arrived):
        rows.append((way, [each.arrived[way] / each.hours for each in both]))
    for label, values in rows:
        print(
            f"{label:32}" + "".join(f"{value:10.3f}" if value < 100 else f"{value:10.0f}" for value in values)
        )


def measure(name: str, engine: str, worlds: int, decisions: int) -> tuple[float, float, float]:
    """Return processor times of a decision and of a reset of one simulation [us, ms], and vehicles in it."""
    built = build_scenario(name)
    roads = built.roads()
    world = World(worlds=worlds, capacity=48, agents=1, lanes=len(roads.lane_ids))
    traffic = traffic_of([engine], world, [roads])
    starts = {
        row: EpisodeStart(
            seed=1, world=row, episode=0, scenario=name, map=0, traffic=built.traffic_files(TRAFFIC),
            traffic_name=TRAFFIC, traffic_seed=traffic_seed(1, world=row), limit=44, agents=(), engine=engine,
        )
        for row in range(worlds)
    }  # fmt: skip
    every = np.ones(worlds, np.bool_)
    times, vehicles = [0.0, 0.0], 0.0
    for is_measured in (False, True):
        begin = time.process_time()
        for row in range(worlds):
            world.clear(row)
        traffic.reset(starts)
        times[1] = time.process_time() - begin
        begin = time.process_time()
        for _ in range(STEPS * (decisions if is_measured else 1)):
            world.advance(every)
            traffic.step(every)
        times[0] = time.process_time() - begin
        vehicles = float(world.vehicles.alive.sum(axis=1).mean())
    traffic.close()
    return times[0] / decisions / worlds * 1e6, times[1] / worlds * 1e3, vehicles


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenarios", nargs="+", default=SCENARIOS)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=300.0)
    parser.add_argument("--time", action="store_true")
    parser.add_argument("--worlds", nargs="+", type=int, default=[1, 8, 64])
    parser.add_argument("--decisions", type=int, default=60)
    options = parser.parse_args()
    if not options.time:
        for name in options.scenarios:
            compare(name, options.seeds, options.seconds)
        return
    print(f"{'':24}{'B':>5}{'us a decision':>15}{'ms a reset':>12}{'vehicles':>10}")
    for name in options.scenarios:
        for worlds in options.worlds:
            for engine in ENGINES:
                if engine == "SUMO" and worlds > 8:
                    continue
                found = measure(name, engine, worlds, options.decisions)
                print(f"{name + ' ' + engine:24}{worlds:5}{found[0]:15.1f}{found[1]:12.2f}{found[2]:10.1f}")


if __name__ == "__main__":
    main()
