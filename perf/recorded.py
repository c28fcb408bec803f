"""Recorded traffic beside SUMO's with as many vehicles: processor time of many simulations, in one run.

    python -m perf.recorded FOLDER [--worlds 64] [--seconds 60] [--traffic recorded]

FOLDER is what `smarts-bench data import` wrote. SUMO drives each recorded vehicle on its route, from the time
on at which it was recorded; it has no more than the recording's roads, so its vehicles may be held up.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from smarts.providers.traffic_engines import traffic_of
from smarts.recordings.log import Log
from smarts.roads.lane_graph import LaneGraph
from smarts.sstudio.build import build_scenario
from smarts.types.episode import EpisodeStart
from smarts.types.recorded import MODES, RecordedTraffic
from smarts.types.traffic import TrafficFiles
from smarts.types.world import World

CAPACITY = 256
"""Slots of a simulation."""


def as_trips(recording: RecordedTraffic, roads: LaneGraph, file: Path) -> tuple[Path, ...]:
    """Write a recording as a route file of SUMO."""
    log, rows = Log.load(recording.log), ["<routes>"]
    for number, route in enumerate(log.routes):
        edges = " ".join(roads.edge_ids[edge] for edge in route)
        depart = max(0.0, log.paths.begin[number] - recording.begin)
        rows.append(f'<vehicle id="{number}" depart="{depart:.2f}" departLane="best" departSpeed="max">')
        rows.append(f'<route edges="{edges}"/></vehicle>' if route else "</vehicle>")
    file.write_text("\n".join([*rows, "</routes>"]), encoding="utf-8")
    return (file,)


def measure(
    engine: str, files: TrafficFiles, roads: LaneGraph, worlds: int, steps: int
) -> tuple[float, float]:
    """Return the processor time of a simulation's second [ms], and how many vehicles it has at a time."""
    world = World(worlds=worlds, capacity=CAPACITY, agents=0, lanes=len(roads.lane_ids))
    traffic, rows, present = traffic_of([engine], world, [roads]), np.ones(worlds, np.bool_), 0
    starts = {
        row: EpisodeStart(1, row, 0, "perf", 0, files, "perf", row, CAPACITY, (), engine)
        for row in range(worlds)
    }
    for counted in (1, steps):  # kernels are compiled, or read, by the first
        for row in range(worlds):
            world.clear(row)
        traffic.reset(starts)
        begin, present = time.process_time(), 0
        for _ in range(counted):
            world.advance(rows)
            traffic.step(rows)
            present += int(world.vehicles.alive.sum())
    spent = time.process_time() - begin
    traffic.close()
    return 1e3 * spent / worlds / (steps * world.dt), present / steps / worlds


def main() -> None:
    """Measure, and print a row for each engine."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder")
    parser.add_argument("--worlds", type=int, default=64)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--traffic", default="recorded")
    given = parser.parse_args()
    built = build_scenario(given.folder)
    files, roads, steps = built.traffic_files(given.traffic), built.roads(), round(given.seconds / 0.1)
    recording = files.recording
    if recording is None:
        raise SystemExit(f"the traffic {given.traffic!r} of {given.folder} is not recorded")
    with TemporaryDirectory() as folder:
        routes = as_trips(recording, roads, Path(folder, "recorded.rou.xml"))
        plain = replace(files, routes=routes, options=(("ignore-route-errors", "true"),))
        sumo, of_sumo = measure("SUMO", plain, roads, given.worlds, steps)
    print(f"{'traffic':20}{'vehicles':>10}{'ms a second':>14}{'times as fast':>15}{'a vehicle':>11}")
    print(f"{'SUMO':20}{of_sumo:10.1f}{sumo:14.3f}{1.0:15.1f}{1.0:11.1f}")
    for mode in MODES:
        played = replace(files, recording=replace(recording, mode=mode))
        spent, vehicles = measure("Recorded", played, roads, given.worlds, steps)
        faster, each = sumo / spent, sumo / of_sumo * vehicles / spent
        print(f"{'Recorded, ' + mode:20}{vehicles:10.1f}{spent:14.3f}{faster:15.1f}{each:11.1f}")


if __name__ == "__main__":
    main()
