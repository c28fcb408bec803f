"""Native traffic beside SUMO's: what it looks like, what it does to scripted policies, and its time.

    python perf/native.py [--scenarios intersection_v1 ...] [--seeds 20] [--seconds 600] [--first-seed 100000]
    python perf/native.py --scripted [keep_lane random gap_acceptance] [--episodes 400]
    python perf/native.py --time [--worlds 1 8 64]

The first has the mean over as many seeds under either engine of rates, shares and throughput by route, and
their difference, as a share of SUMO's but for shares and overlaps; `noise` is its standard error. Of the
distributions (`KS`) the difference is the mean distance of half of Native's seeds from half of SUMO's, the
noise that of SUMO's from each other, over the same 20 divisions. Rules are tuned with seeds below 1,000.

The second plays scripted policies with kinematic vehicles; `noise` is the standard error with the episode as
unit, `p` is corrected by Holm over all rows. The last measures processor time of a decision (five steps) of
one simulation and of a reset, by how many there are. `--out` writes the rows as CSV, too.
"""

from __future__ import annotations

import argparse
import csv
import math
import time
from collections import defaultdict
from collections.abc import Mapping
from contextlib import closing
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from algorithms.joint.episode_indices import FIRST_TEST_EPISODE
from benchmark.scripted.play import episodes_of
from benchmark.statistics import holm
from smarts.agents.benchmark import benchmark_interface
from smarts.env.vector import VectorHiWayEnv
from smarts.geometry.boxes import boxes_overlap
from smarts.providers.traffic_engines import traffic_of
from smarts.roads.agent_routes import AgentRoutes
from smarts.roads.atlas import RoadAtlas
from smarts.roads.scene import Scene
from smarts.sim import traffic_run
from smarts.sim.assembly import Options
from smarts.sim.map_matching import MapMatcher
from smarts.sstudio.build import build_scenario
from smarts.types.agent_states import agent_names
from smarts.types.episode import EpisodeStart
from smarts.types.streams import traffic_seed
from smarts.types.vehicles import VehicleStates
from smarts.types.world import World

V1 = ("intersection_v1", "two_way_v1", "double_merge_v1")
SCENARIOS = (*V1, "roundabout", "on_ramp_merge", "city")
POLICIES = ("keep_lane", "random", "gap_acceptance")
TRAFFIC = "random_social_vehicles"
ENGINES = ("SUMO", "Native")
CAPACITY, STEPS, SAMPLED, NEAR = 640, 5, 5, 7.0
"""Slots; steps of a decision; steps between samples; vehicles farther apart do not overlap [m]."""
SPLITS, FREQUENT, AGENTS = 20, 200, 4
"""Divisions; arrivals with both engines from which on a route has a row; agents of an episode."""
BINS = {
    "headway": np.arange(0.0, 15.0, 0.05),
    "gap": np.arange(-2.0, 150.0, 0.25),
    "speed": np.arange(-0.025, 40.0, 0.05),
    "acceleration": np.arange(-9.025, 5.0, 0.05),
}
"""Edges of the bins of each distribution [s, m, m/s, m/s^2]; what lies outside counts in the last ones."""
ABSOLUTE = ("share standing", "overlapping pairs an hour")
"""Measures whose difference is not given as a share of SUMO's."""
Row = tuple[str, str, float, float, float, float]
"""Scenario, measure, SUMO's, Native's, difference, noise."""


Sample = tuple[dict[str, float], dict[str, NDArray]]
"""One seed's rates, shares and throughput by route; vehicles in each bin of each distribution."""


def observe(name: str, engine: str, seed: int, seconds: float) -> Sample:
    """Return what a scenario's traffic without agents looks like."""
    built = build_scenario(name)
    traffic_run.CAPACITY, roads = CAPACITY, built.roads()
    atlas, overlapping = RoadAtlas([roads]), set()
    arrived: dict[str, float] = defaultdict(float)
    found: dict[str, list[NDArray]] = {label: [] for label in BINS}
    with traffic_run.traffic_run(built, TRAFFIC, seed=seed, engine=engine) as run:
        matcher = MapMatcher(Scene(run.world, atlas, AgentRoutes(atlas, 1, 0)))
        routes: dict[tuple[int, int], int] = {}
        for step, states in enumerate(run.steps(seconds)):
            alive = np.flatnonzero(states.alive)
            now = {(slot, int(states.generation[slot])): int(states.route[slot]) for slot in alive.tolist()}
            for vehicle in routes.keys() - now.keys():
                way = run.world.routes.edges(0, routes[vehicle])
                arrived[f"{roads.edge_ids[way[0]]} to {roads.edge_ids[way[-1]]}"] += 3600.0 / seconds
            # A vehicle's first route counts: SUMO's is what is left of it.
            routes = {vehicle: routes.get(vehicle, route) for vehicle, route in now.items()}
            if step % SAMPLED == 0:
                overlapping |= overlaps(states, alive)
                matcher.match(np.ones(1, np.bool_))
                for label, values in distributions(states, alive).items():
                    found[label].append(values)
    speed = np.concatenate(found["speed"])
    means = {
        "vehicles": len(speed) / len(found["speed"]),
        "mean speed [m/s]": float(speed.mean()),
        "share standing": float((speed < 0.1).mean()),
        "arrivals an hour": sum(arrived.values()),
        "overlapping pairs an hour": len(overlapping) / seconds * 3600.0,
        **arrived,
    }
    clipped = {
        label: np.clip(np.concatenate(found[label]), edges[0], edges[-1]) for label, edges in BINS.items()
    }
    return means, {label: np.histogram(clipped[label], edges)[0] for label, edges in BINS.items()}


def distributions(states: VehicleStates, alive: NDArray) -> dict[str, NDArray]:
    """Return speeds, accelerations, and gaps and headways to the next vehicle in the same lane."""
    order = alive[np.lexsort((states.lane_position[alive], states.lane[alive]))]
    behind, ahead = order[:-1], order[1:]
    follows = (states.lane[behind] == states.lane[ahead]) & (states.lane[behind] >= 0)
    behind, ahead = behind[follows], ahead[follows]
    gap = states.lane_position[ahead] - states.lane_position[behind]
    gap -= 0.5 * (states.length[ahead] + states.length[behind])
    moves, speed = states.speed[behind] > 1.0, states.speed[alive]
    headway = gap[moves] / states.speed[behind][moves]
    return {"headway": headway, "gap": gap, "speed": speed, "acceleration": states.acceleration[alive]}


def overlaps(states: VehicleStates, alive: NDArray) -> set[tuple[int, ...]]:
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
            found.add((int(first), int(second), *map(int, states.generation[[first, second]])))
    return found


def compare(name: str, seeds: range, seconds: float) -> list[Row]:
    """Return both engines' statistics of a scenario."""
    both = [[observe(name, engine, seed, seconds) for seed in seeds] for engine in ENGINES]
    labels = dict.fromkeys(label for samples in both for means, _ in samples for label in means)
    rows = []
    for label in labels:
        values = [np.array([means.get(label, 0.0) for means, _ in samples]) for samples in both]
        if " to " in label and np.sum(values) * seconds / 3600.0 < FREQUENT:
            continue
        row = _row(name, label, values)
        rows.append(row if label in ABSOLUTE else (*row[:4], row[4] / row[2], row[5] / row[2]))
    return rows + [_distance(name, label, both) for label in BINS]


def _row(scenario: str, label: str, both: list[NDArray]) -> Row:
    """Return means of both engines, their difference and its standard error."""
    sumo, native = (float(values.mean()) for values in both)
    return scenario, label, sumo, native, native - sumo, math.sqrt(sum(v.var(ddof=1) / len(v) for v in both))


def _distance(scenario: str, label: str, both: list[list[Sample]]) -> Row:
    """Return the medians of a distribution, its distance from SUMO's, and that of SUMO's from itself."""
    sumo, native = (np.array([counts[label] for _, counts in samples]) for samples in both)
    draws, distances = np.random.default_rng(0), []
    for _ in range(SPLITS):
        first, second = np.array_split(draws.permutation(len(sumo)), 2)
        distances.append((_ks(native[first], sumo[second]), _ks(sumo[first], sumo[second])))
    medians = [BINS[label][np.searchsorted(np.cumsum(_shares(counts)), 0.5)] for counts in (sumo, native)]
    (sumo_median, native_median), (distance, noise) = map(float, medians), np.mean(distances, axis=0).tolist()
    return scenario, f"KS of {label}", sumo_median, native_median, distance, noise


def _shares(counts: NDArray) -> NDArray:
    total = counts.sum(axis=0)
    return total / max(total.sum(), 1.0)


def _ks(first: NDArray, second: NDArray) -> float:
    """Return the largest distance of two pooled distributions, shape (seeds, bins) each."""
    return float(np.abs(np.cumsum(_shares(first) - _shares(second))).max())


def play(policy: str, scenario: str, engine: str, episodes: int) -> list[Mapping[str, float]]:
    """Return the metrics of a scripted policy's valid episodes."""
    options = Options(policy=policy, traffic_engine=engine)
    agents = dict.fromkeys(agent_names(AGENTS), benchmark_interface(vehicle_model="kinematic"))
    env = VectorHiWayEnv(1, [scenario], agents, simulation=options, traffic=[TRAFFIC], reward="benchmark")
    with closing(env):
        played = episodes_of(env, policy, 42, FIRST_TEST_EPISODE)
        return list(islice((each for each in played if not each["invalid"]), episodes))


def compare_scripted(policies: list[str], scenarios: list[str], episodes: int) -> list[tuple]:
    """Return rates of collision and completion with each policy; the last columns are z and Holm's p."""
    rows = []
    for scenario in scenarios:
        for policy in policies:
            both = [play(policy, scenario, engine, episodes) for engine in ENGINES]
            for outcome in ("collision", "goal"):
                rates = [np.array([each[outcome] for each in played]) for played in both]
                rows.append(_row(scenario, f"{policy}: {outcome}", rates))
    z = [row[4] / row[5] if row[5] else 0.0 for row in rows]
    p_values = holm([2.0 * norm.sf(abs(each)) for each in z])
    return [(*row, each, float(p)) for row, each, p in zip(rows, z, p_values, strict=True)]


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
    times = [0.0, 0.0]
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
    traffic.close()
    vehicles = float(world.vehicles.alive.sum()) / worlds
    return times[0] / decisions / worlds * 1e6, times[1] / worlds * 1e3, vehicles


def show(columns: list[str], rows: list[tuple], out: Path | None, is_new: bool) -> None:
    """Print rows, and append them to a file."""
    print(f"{columns[0]:18}{columns[1]:34}" + "".join(f"{each:>11}" for each in columns[2:]))
    for row in rows:
        print(f"{row[0]:18}{row[1]:34}" + "".join(f"{each:>11.3f}" for each in row[2:]), flush=True)
    if out is not None:
        with out.open("w" if is_new else "a", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerows([columns] if is_new else [])
            writer.writerows([[*row[:2], *(f"{each:.4g}" for each in row[2:])] for row in rows])


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenarios", nargs="+")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=100_000)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--scripted", nargs="*", metavar="POLICY")
    parser.add_argument("--episodes", type=int, default=400)
    parser.add_argument("--time", action="store_true")
    parser.add_argument("--worlds", nargs="+", type=int, default=[1, 8, 64])
    parser.add_argument("--decisions", type=int, default=60)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    columns = ["scenario", "measure", *ENGINES, "difference", "noise"]
    scenarios = options.scenarios or (SCENARIOS if options.scripted is None and not options.time else V1)
    if options.time:
        rows = [
            (name, f"{engine}, {worlds} simulations", *measure(name, engine, worlds, options.decisions))
            for name in scenarios
            for worlds in options.worlds
            for engine in ENGINES
            if engine == "Native" or worlds <= 8
        ]
        show(["scenario", "measure", "us", "ms a reset", "vehicles"], rows, options.out, True)
    elif options.scripted is not None:
        rows = compare_scripted(options.scripted or list(POLICIES), list(scenarios), options.episodes)
        show([*columns, "z", "p"], rows, options.out, True)
    else:
        seeds = range(options.first_seed, options.first_seed + options.seeds)
        for name in scenarios:
            show(columns, compare(name, seeds, options.seconds), options.out, name == scenarios[0])


if __name__ == "__main__":
    main()
