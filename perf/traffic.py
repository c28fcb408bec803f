"""Cost of the SUMO traffic provider beside bare SUMO, measured side by side in one run.

    python perf/traffic.py [--scenarios loop intersection city] [--steps 600] [--repeats 5]

"bare" is the same library on the same files: load, then a loop over `simulationStep` without reading.
"subscribed" is the usual way to read it: a subscription per vehicle and all results as dictionaries.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Iterable

import numpy as np

from smarts.providers.sumo_library import SumoLibrary
from smarts.providers.sumo_traffic import SumoTraffic, sumo_options
from smarts.roads.lane_graph import LaneGraph
from smarts.sstudio.build import build_scenario
from smarts.types.traffic import TrafficFiles
from smarts.types.vehicles import Owner, VehicleKind
from smarts.types.world import World

DT, SEED = 0.1, 7
EGOS = 4
BLOCK = 50
READ = (0x42, 0x43, 0x40, 0x72, 0x51, 0x56, 0xB7)
"""SUMO's numbers for position, angle, speed, acceleration, lane, lane position and allowed speed."""


class Bare:
    """SUMO alone, or with subscriptions."""

    def __init__(self, files: TrafficFiles, subscribe: bool = False) -> None:
        self.files = files
        self.library = SumoLibrary()
        self.subscribe = subscribe

    def reset(self) -> None:
        """Load and warm up."""
        self.library.start(sumo_options(self.files, SEED, DT))
        for _ in range(round(self.files.warm_up / DT)):
            self.library.simulation.step(0.0)
        if self.subscribe:
            self._subscribe(self.library.vehicle.getIDList())

    def step(self) -> None:
        """Advance, and take all results if subscribed."""
        self.library.simulation.step(0.0)
        if self.subscribe:
            self._subscribe(self.library.simulation.getDepartedIDList())
            self.library.vehicle.getAllSubscriptionResults()

    def close(self) -> None:
        """Give the library back."""
        self.library.close()

    def _subscribe(self, names: Iterable[str]) -> None:
        for name in names:
            self.library.vehicle.subscribe(name, READ, 0.0, 1e9, {})


class Ours:
    """The provider, with egos that drive behind each other along the longest lane."""

    def __init__(self, files: TrafficFiles, roads: LaneGraph, egos: int = 0) -> None:
        self.files, self.roads, self.egos = files, roads, egos
        self.world = World(worlds=1, capacity=1024, agents=0, lanes=len(roads.lane_ids), dt=DT)
        self.states = self.world.vehicles.of(0)
        self.traffic = SumoTraffic(self.world, 0)
        self.moment = 0
        lane = int(np.argmax(np.where(roads.is_internal, 0.0, roads.length)))
        self.track = np.array([roads.pose_at(lane, s) for s in np.arange(0.0, roads.length[lane], 0.5)])

    def reset(self) -> None:
        """Admit the egos and let the provider begin."""
        self.world.clear(0)
        self.moment = 0
        for ego in range(self.egos):
            self.world.registry.admit(0, f"ego-{ego}", Owner.AGENT, VehicleKind.PASSENGER, 4.5, 1.8)
            self._move(ego)
        self.traffic.reset(self.files, SEED, self.roads)

    def step(self) -> None:
        """Move the egos and let the provider follow."""
        self.moment += 1
        for ego in range(self.egos):
            self._move(ego)
        self.traffic.step()

    def close(self) -> None:
        """Give the library back."""
        self.traffic.close()

    def vehicles(self) -> int:
        """Return how many vehicles SUMO drives now."""
        return int((self.states.owner == Owner.TRAFFIC).sum())

    def _move(self, ego: int) -> None:
        x, y, self.states.heading[ego] = self.track[(30 * ego + self.moment) % len(self.track)]
        self.states.position[ego] = x, y
        self.states.speed[ego] = 5.0


def timed(task: Callable[[], object], count: int = 1) -> float:
    """Return how long a task takes [s], the mean over a number of times."""
    begin = time.process_time()
    for _ in range(count):
        task()
    return (time.process_time() - begin) / count


def measure(name: str, steps: int, repeats: int) -> None:
    """Print one scenario's table; the runs take turns in short blocks, so that all see the same machine."""
    built = build_scenario(name)
    files, roads = built.traffic["random_social_vehicles"], built.roads()
    ours = Ours(files, roads)
    runs = {
        "bare": Bare(files),
        "subscribed": Bare(files, subscribe=True),
        "ours": ours,
        f"ours, {EGOS} egos": Ours(files, roads, EGOS),
    }
    resets = dict.fromkeys(runs, math.inf)
    blocks: dict[str, list[float]] = {label: [] for label in runs}
    vehicles = []
    for _ in range(repeats):
        for label, run in runs.items():
            resets[label] = min(resets[label], timed(run.reset))
        for _ in range(max(steps // BLOCK, 1)):
            for label, run in runs.items():
                blocks[label].append(timed(run.step, BLOCK))
            vehicles.append(ours.vehicles())
    print(f"{name}: {np.mean(vehicles):.0f} vehicles on average, warm-up {files.warm_up:.0f} s")
    for label, run in runs.items():
        step, ratio = np.median(blocks[label]), np.median(np.divide(blocks[label], blocks["bare"]))
        line = f"  {label:13} step {step * 1e3:6.3f} ms ({ratio:4.2f} x bare)"
        print(f"{line}   reset {resets[label] * 1e3:6.1f} ms")
        run.close()
    allowed = 0.010 + 1.3 * resets["bare"]
    print(f"  reset: {resets['ours'] * 1e3:.1f} ms of {allowed * 1e3:.1f} ms allowed (10 ms + 1.3 x bare)")


def main() -> None:
    """Measure what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--scenarios", nargs="+", default=["loop", "intersection", "city"])
    parser.add_argument("--steps", type=int, default=600)
    parser.add_argument("--repeats", type=int, default=5)
    arguments = parser.parse_args()
    for name in arguments.scenarios:
        measure(name, arguments.steps, arguments.repeats)


if __name__ == "__main__":
    main()
