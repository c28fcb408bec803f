"""Measure what bubbles cost in which no vehicle is, as a share of the step of the same run.

    python -m perf.bubbles --scenarios city intersection --bubbles 1 8 --steps 300

In each step the time of the step without bubbles is taken, and then that of the bubbles' own stage calls in
the same state. The bubbles lie beside the lanes, and their bounds cover all of the map. The share is the
ratio of the medians.
"""

from __future__ import annotations

import argparse
import statistics
import time
from dataclasses import dataclass, replace

import numpy as np

from smarts.agents.benchmark import benchmark_interface
from smarts.bubbles import Driver, place_bubbles
from smarts.roads.lane_graph import LaneGraph
from smarts.sim.assembly import Assembly, assemble
from smarts.sim.bubble_rules import BubbleRules
from smarts.sstudio import build_scenario
from smarts.sstudio import sstypes as t
from smarts.types.bubbles import PlacedBubble
from smarts.types.episode import EpisodeStart
from smarts.types.events import Events

EGOS = 2
TARGET = 0.03
"""The largest share of a step."""


@dataclass(frozen=True)
class Share:
    """What the bubbles of one run cost."""

    step: float
    """Of the simulation without bubbles [s]."""
    bubbles: float
    """Of the bubbles [s]."""
    vehicles: int
    """Most vehicles at a time, in all simulations."""

    @property
    def share(self) -> float:
        """Of the bubbles in a step."""
        return self.bubbles / self.step


def empty_bubbles(roads: LaneGraph, count: int) -> tuple[PlacedBubble, ...]:
    """Return bubbles beside the lanes of a map, whose bounds cover all of it."""
    (left, low), (right, high) = roads.point_xy.min(0), roads.point_xy.max(0)
    actor = t.SocialAgentActor("nobody", "smarts.zoo:keep-lane-v0")
    bubbles = []
    for number in range(count):
        # Wide in one direction, so that the bounds alone do not decide.
        x = left - 50.0 - 30.0 * number
        corners = [(x, low), (x + 10.0, low), (x + 10.0, high), (right, high + 50.0), (right, high + 60.0)]
        bubbles.append(t.Bubble(t.ConfigurableZone([*corners, (x, high + 60.0)]), actor, margin=5.0))
    return place_bubbles(bubbles, roads, lambda bubble: Driver(0, 0))


def measure(name: str, bubbles: int, worlds: int, steps: int) -> Share:
    """Return the share of a number of empty bubbles in one scenario."""
    built = build_scenario(name)
    parts = assemble([built], [benchmark_interface()] * EGOS, worlds=worlds)
    try:
        return _measure(parts, empty_bubbles(built.roads(), bubbles), steps)
    finally:
        parts.simulation.close()


def _measure(parts: Assembly, bubbles: tuple[PlacedBubble, ...], steps: int) -> Share:
    world, mask = parts.simulation.world, np.ones(parts.simulation.world.worlds, np.bool_)
    rules = BubbleRules(
        world, parts.scene.routes, parts.pool, lambda rows, slots: np.zeros(len(rows), np.int8)
    )
    starts = {row: _with_traffic(parts, row) for row in range(world.worlds)}
    parts.simulation.reset(starts)
    for row, start in starts.items():
        rules.begin(row, replace(start, bubbles=bubbles))
    everyone = np.ones(world.agents.slot.shape, np.bool_)
    events = Events.allocate(*world.agents.slot.shape)
    taken: list[tuple[float, float]] = []
    most = 0
    for _ in range(steps):
        parts.actions.given[:] = True
        parts.actions.values[:] = 0
        begin = time.perf_counter()
        parts.simulation.step(parts.actions, mask, everyone)
        middle = time.perf_counter()
        rules.place(mask)
        proposed = rules.propose(events, mask)
        taken.append((middle - begin, time.perf_counter() - middle))
        assert not len(proposed)
        most = max(most, int(world.vehicles.alive.sum()))
    # The first steps compile.
    counted = taken[len(taken) // 5 :]
    step, own = (statistics.median(column) for column in zip(*counted, strict=True))
    return Share(step, own, most)


def _with_traffic(parts: Assembly, row: int) -> EpisodeStart:
    """Return the first episode with traffic from the beginning on."""
    starts = [parts.schedule.start(row, episode) for episode in range(len(parts.schedule.combinations))]
    return next((start for start in starts if start.traffic.warm_up), starts[0])


def main() -> int:
    """Print the shares and the worst of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--scenarios", nargs="+", default=["intersection", "city"])
    parser.add_argument("--bubbles", nargs="+", type=int, default=[1, 8])
    parser.add_argument("--worlds", nargs="+", type=int, default=[1, 4])
    parser.add_argument("--steps", type=int, default=300)
    arguments = parser.parse_args()
    worst = 0.0
    print("scenario       simulations  bubbles  vehicles  step [ms]  bubbles [ms]  share")
    for name in arguments.scenarios:
        for worlds in arguments.worlds:
            for count in arguments.bubbles:
                found = measure(name, count, worlds, arguments.steps)
                worst = max(worst, found.share)
                print(
                    f"{name:14} {worlds:11} {count:8} {found.vehicles:9} {1000 * found.step:10.3f}"
                    f" {1000 * found.bubbles:13.4f} {found.share:6.1%}"
                )
    print(f"worst share {worst:.1%}, target {TARGET:.0%}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
