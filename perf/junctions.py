"""What agents that drive vehicles of traffic across junctions do there, beside SUMO's own drivers.

    python -m perf.junctions                                     # all scenarios, idm, keep-lane, fallback
    python -m perf.junctions --scenarios intersection --drivers idm-v0 --takes 200 --mixed

Bubbles cover the junctions. Each episode is played twice with the same seed, with and without the bubbles.
A vehicle counts from where it enters a bubble's zone until 10 s after it has left it; with bubbles, if an
agent has taken it. It crashes if its footprint comes to overlap another one while it counts. "stands" is the
longest time below 0.1 m/s of a vehicle that counts, "passed" are the vehicles that came out of a zone.
"""

from __future__ import annotations

import argparse
import shutil
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from perf.handovers import with_big_vehicles
from smarts.agents import ActionBatch
from smarts.env.actions import ActionEncoder
from smarts.env.casting import cast_of
from smarts.env.social_agents import SocialAgentRequests
from smarts.geometry.boxes import boxes_overlap
from smarts.sim.assembly import Assembly, assemble
from smarts.sstudio import build_scenario
from smarts.sstudio import types as t
from smarts.sstudio.build import build_described, read_scenario
from smarts.sstudio.built import BuiltScenario
from smarts.types.agent_states import AgentStatus
from smarts.types.episode import EpisodeStart
from smarts.types.vehicles import Owner, VehicleKind
from smarts.zoo import register
from smarts.zoo.agents.idm import IdmDriver

Zones = Sequence[tuple[tuple[float, float], float]]

ZONES: dict[str, Zones] = {
    "intersection": [((0, 0), 120)],
    "roundabout": [((0, 0), 130)],
    "on_ramp_merge": [((80, -5), 260)],
    "city": [((678, 269), 90), ((128, 511), 90), ((688, 762), 90), ((667, 513), 90), ((274, 381), 90)],
}
"""Middle and side of each bubble's zone [m]."""
DRIVERS = ("idm-v0", "keep-lane-v0", "perf.junctions:fails-v0", "perf.junctions:fails-late-v0")
STEPS = 600
"""Steps of an episode."""
COUNTED = 10.0
"""A vehicle counts so long after it has left the zone [s]."""
REACH = 20.0
"""Vehicles whose centres are farther apart do not overlap [m]."""
STANDING = 0.1
"""A slower vehicle stands [m/s]."""
DEEP = 0.05
"""Footprints that overlap by less only touch [m]."""


class Fails(IdmDriver):
    """Drives by IDM and fails after some decisions, so that the fallback controller drives on.

    Args:
        after: How many.
    """

    def __init__(self, after: int = 0) -> None:
        super().__init__()
        self._after = after
        self._decisions: Counter[int] = Counter()

    def act(self, obs: ActionBatch) -> NDArray:
        """Return actions, NaN for the vehicles that the agent has driven for long enough."""
        actions = super().act(obs)
        for row, (hold, drives) in enumerate(zip(obs.hold.tolist(), obs.drives.tolist(), strict=True)):
            self._decisions[hold] += drives
            if self._decisions[hold] > self._after + hold % 8:
                actions[row] = np.nan
        return actions


register("fails-v0", Fails)
register("fails-late-v0", Fails, after=15)


@dataclass
class Tally:
    """What happened to the vehicles that counted in some runs."""

    vehicles: int = 0
    """That came into a zone, or were taken over there."""
    passed: int = 0
    crashed: int = 0
    by_agents: int = 0
    """Crashes in which an agent, or the fallback controller, drove one of the two."""
    stands: list[float] = field(default_factory=list)
    """Longest time that each has stood [s]."""
    steps: int = 0
    lines: list[str] = field(default_factory=list)
    """A line for each crash."""

    def row(self) -> str:
        """Return the cells of a table."""
        share = self.crashed / max(self.vehicles, 1)
        agents = self.by_agents / max(self.vehicles, 1)
        stands = np.array(self.stands or [0.0])
        return (
            f"{self.vehicles:9}{self.crashed:9}{share:8.1%}{agents:10.1%}"
            f"{stands.max():9.1f}{(stands >= 20.0).sum():8}{stands.mean():8.1f}{self.passed:8}"
        )


class Watch:
    """Watches the vehicles of one simulation in the zones.

    Args:
        parts: The simulation.
        zones: Middle and side of each square [m].
        only_taken: Whether only vehicles that an agent has taken over count.
        tally: Written.
    """

    def __init__(self, parts: Assembly, zones: Zones, only_taken: bool, tally: Tally) -> None:
        self._world, self._zones, self._only_taken, self.tally = (
            parts.simulation.world,
            zones,
            only_taken,
            tally,
        )
        count = self._world.vehicles.capacity
        self._generation = np.full(count, -1)
        self._until = np.full(count, -1)
        """Step up to which each vehicle counts."""
        self._taken, self._known, self._inside, self._crashed = np.zeros((4, count), np.bool_)
        self._stood, self._longest = np.zeros((2, count), np.int64)

    def step(self) -> None:
        """Count what the last step has done."""
        vehicles, now = self._world.vehicles.of(0), int(self._world.step[0])
        self._forget(vehicles.alive & (vehicles.generation == self._generation))
        self._generation = np.where(vehicles.alive, vehicles.generation, -1)
        self._taken |= vehicles.alive & (vehicles.owner == Owner.AGENT)
        inside = np.zeros(len(self._until), np.bool_)
        for middle, side in self._zones:
            inside |= (np.abs(vehicles.position - middle) <= 0.5 * side).all(axis=1)
        inside &= vehicles.alive
        self._until[inside] = now + round(COUNTED / self._world.dt)
        counts = vehicles.alive & (self._until >= now) & (self._taken | (not self._only_taken))
        self.tally.vehicles += int((counts & ~self._known).sum())
        self._known |= counts
        self.tally.passed += int((counts & self._inside & ~inside & ~self._crashed).sum())
        self._inside = inside
        self._stood = np.where(vehicles.alive & (vehicles.speed < STANDING), self._stood + 1, 0)
        self._longest = np.maximum(self._longest, np.where(counts, self._stood, 0))
        self._note_crashes(np.flatnonzero(counts & ~self._crashed))
        self.tally.steps += 1

    def end(self) -> None:
        """Count the vehicles that are still there."""
        self._forget(np.zeros(len(self._until), np.bool_))

    def _forget(self, kept: NDArray) -> None:
        gone = self._known & ~kept
        self.tally.stands += (self._longest[gone] * self._world.dt).tolist()
        for flags in (self._taken, self._known, self._inside, self._crashed):
            flags &= kept
        self._until[~kept], self._stood[~kept], self._longest[~kept] = -1, 0, 0

    def _note_crashes(self, slots: NDArray) -> None:
        vehicles = self._world.vehicles.of(0)
        others = np.flatnonzero(vehicles.alive)
        apart = vehicles.position[slots, None] - vehicles.position[others]
        near = (np.abs(apart).max(axis=-1) < REACH) & (slots[:, None] != others)
        rows, columns = np.nonzero(near)
        a, b = slots[rows], others[columns]
        size = np.column_stack([vehicles.length, vehicles.width]) - DEEP
        pose = vehicles.position, vehicles.heading, size
        hit = boxes_overlap(*(each[a] for each in pose), *(each[b] for each in pose))
        for slot, other in zip(a[hit].tolist(), b[hit].tolist(), strict=True):
            if not self._crashed[slot]:
                self._crashed[slot] = True
                self.tally.crashed += 1
                self.tally.by_agents += bool((vehicles.owner[[slot, other]] == Owner.AGENT).any())
                self.tally.lines.append(f"{self._line(slot)} | {self._line(other)}")

    def _line(self, slot: int) -> str:
        vehicles, world = self._world.vehicles.of(0), self._world
        x, y = vehicles.position[slot]
        return (
            f"{world.time[0]:.1f} s {world.registry.name(0, slot)} {Owner(int(vehicles.owner[slot])).name}"
            f" {VehicleKind(int(vehicles.kind[slot])).name} ({x:.1f}, {y:.1f})"
            f" {vehicles.heading[slot]:.2f} rad {vehicles.speed[slot]:.1f} m/s"
            f" lane {vehicles.lane[slot]} {vehicles.lane_position[slot]:.1f} m"
        )


def with_bubbles(name: str, driver: str, folder: Path) -> BuiltScenario:
    """Return a scenario of the suite without egos, with bubbles over its junctions."""
    source = build_scenario(name).source
    copy = folder / f"{name}-{driver.partition(':')[2] or driver}"
    shutil.copytree(source, copy, ignore=shutil.ignore_patterns("build", "scenario.py", "*.md"))
    actor = t.SocialAgentActor("driver", driver)
    bubbles = tuple(
        t.Bubble(t.PositionalZone(middle, (side, side)), actor, margin=10, id=f"junction-{number}")
        for number, (middle, side) in enumerate(ZONES[name])
    )
    scenario = replace(read_scenario(name), ego_missions=(), bubbles=bubbles, held_out={})
    return build_described(copy, scenario).with_traffic(["random_social_vehicles"])


class Player:
    """Plays episodes of a scenario, with or without its bubbles."""

    def __init__(self, built: BuiltScenario, zones: Zones, seed: int) -> None:
        self.parts = assemble([built], [], worlds=1, seed=seed, cast=cast_of([built]))
        self._zones = zones

    def play(self, start: EpisodeStart, steps: int, tally: Tally) -> None:
        """Play an episode."""
        parts = self.parts
        world, mask = parts.simulation.world, np.ones(1, np.bool_)
        requests = SocialAgentRequests(parts, ActionEncoder(parts.actions, world.agents.action_mask))
        watch = Watch(parts, self._zones, bool(start.bubbles), tally)
        frame = parts.simulation.reset({0: start})
        for _ in range(steps):
            requests.dispatch(frame, frame.observe_mask.copy())
            failed = requests.gather()
            shadows = world.agents.state == AgentStatus.SHADOWING
            due = shadows | (world.agents.next_due <= world.step[:, None] + 1)
            frame = parts.simulation.step(parts.actions, mask, due, failed)
            if frame.failures:
                raise next(iter(frame.failures.values()))
            parts.actions.fresh[:] = False
            requests.collect(frame)
            watch.step()
        watch.end()
        requests.close()


def measure(
    name: str, driver: str, takes: int, seed: int, is_mixed: bool, folder: Path
) -> tuple[Tally, Tally]:
    """Return what happened with bubbles and without."""
    driven, plain = Tally(), Tally()
    player = Player(with_bubbles(name, driver, folder), ZONES[name], seed)
    try:
        episode = 0
        while driven.vehicles < takes:
            start = player.parts.schedule.start(0, episode)
            start = with_big_vehicles(start, folder) if is_mixed else start
            before = driven.vehicles
            player.play(start, STEPS, driven)
            player.play(replace(start, bubbles=()), STEPS, plain)
            if driven.vehicles == before:
                raise SystemExit(f"{name}: no vehicle was taken over in episode {episode}")
            episode += 1
    finally:
        player.parts.simulation.close()
    return driven, plain


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the measurements that the command line asks for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenarios", nargs="+", default=[*ZONES], choices=[*ZONES])
    parser.add_argument("--drivers", nargs="+", default=DRIVERS)
    parser.add_argument("--takes", type=int, default=200)
    parser.add_argument("--mixed", action="store_true", help="a fourth of the vehicles are buses and trucks")
    parser.add_argument("--seed", type=int, default=42)
    parser.add_argument("--each", action="store_true", help="print a line for each crash")
    given = parser.parse_args(arguments)
    print(f"{'':50}vehicles  crashed   share by agents   stands  >= 20 s    mean  passed", flush=True)
    with TemporaryDirectory() as folder:
        for name in given.scenarios:
            for driver in given.drivers:
                begin = time.perf_counter()
                tallies = measure(name, driver, given.takes, given.seed, given.mixed, Path(folder))
                for what, tally in zip((driver, "without bubbles"), tallies, strict=True):
                    print(f"{name:15} {what:33}{tally.row()}", flush=True)
                    if given.each and tally.lines:
                        print("\n".join(tally.lines))
                print(f"  {tallies[0].steps} steps each, {time.perf_counter() - begin:.0f} s", flush=True)


if __name__ == "__main__":
    main()
