"""Speed of the environment, where the time of a step goes, and the ratio to a bare loop.

    python -m perf.step                                    # loop and intersection, B = 1 and 8
    python -m perf.step --scenarios city --social 300 --worlds 1
    python -m perf.step --scenarios loop --egos 32 --worlds 1
    python -m perf.step --scenarios loop --social 10 25 50 100 --worlds 1

One process on one core. The environment is `VectorHiWayEnv` with the benchmark's observation (three stacked
frames), reward and masks, a decision every five steps; egos keep their lanes, in Bullet. A decision counts
only if in each of its steps all egos of all simulations drive at more than 1 m/s among as many social
vehicles as asked for, within 12% (25 +- 3); a simulation in which that ends is reset, which is timed apart.
The bare loop (`perf.bare`) drives the same episodes in turn with ours. Stages are timed in blocks of their
own, wrapped in clocks from outside; the product has none. Time is the processor time of this process, which
on an idle machine is the time by the wall.
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from perf.bare import DT, BareLoop, Beginning, Pose
from perf.scenes import BAND, scene
from smarts.env.vector import VectorHiWayEnv
from smarts.errors import SmartsError, TrafficError
from smarts.geometry.frames import compass_from_heading
from smarts.types.frame import Frame
from smarts.types.vehicles import Owner

PERIOD = 5
BLOCK = 20
"""Decisions that ours and the bare loop make in turn."""
SLOWEST = 1.0
"""Least speed of an ego that moves [m/s]."""
UNDER_WAY = 15
"""Steps within which egos that start at rest have to move."""
MOST_RESETS = 50
"""Episodes in a row that may begin with another number of vehicles."""


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
            begin = time.process_time()
            result = value(*arguments)
            self._spent[f"{self._name}.{name}"] += time.process_time() - begin
            return result

        setattr(self, name, timed)
        return timed


@dataclass
class Decision:
    """What one decision of all simulations left behind."""

    poses: list[list[list[Pose]]] = field(default_factory=list)
    """By step, simulation and ego."""
    social: list[np.ndarray] = field(default_factory=list)
    """Social vehicles by step, shape (B,)."""
    slowest: list[float] = field(default_factory=list)
    """Slowest ego by step, below zero if one is missing [m/s]."""
    traffic: list[set[str]] = field(default_factory=list)
    """Names of the social vehicles at its end, by simulation."""
    begun: dict[int, Beginning] = field(default_factory=dict)
    """Episodes that begin after it, by simulation."""
    seconds: float = 0.0
    counts: bool = False


class Run:
    """The environment under measurement, which remembers what the bare loop needs.

    Args:
        source: Folder of the scenario.
        worlds: B.
        egos: N.
        social: Vehicles of traffic asked for.
    """

    def __init__(self, source: Path, worlds: int, egos: int, social: int) -> None:
        self.env = VectorHiWayEnv(worlds, [source], egos, decision_interval=PERIOD)
        self._runner = self.env._runner
        self._simulation = self._runner.simulation
        self._advance = self._simulation.step
        self._simulation.step = self._watched
        self._band = (1.0 - BAND) * social, (1.0 + BAND) * social
        self._actions = [np.zeros((worlds, egos), np.int64)]
        self._now = Decision()
        self._aside = 0.0
        self.spent: dict[str, float] = defaultdict(float)
        self._plain = self._simulation._stages
        self._timed = dataclasses.replace(
            self._plain,
            **{
                part.name: Clock(getattr(self._plain, part.name), part.name, self.spent)
                for part in dataclasses.fields(self._plain)
                if getattr(self._plain, part.name) is not None
            },
        )
        engines: Any = self._plain.traffic
        self._drivers = engines._simulations
        self.resets: list[float] = []

    def begin(self) -> dict[int, Beginning]:
        """Begin the first episodes."""
        step = self.env.reset()
        return self._begun(set(range(len(step.reset))))

    def block(self, decisions: int, *, in_stages: bool) -> list[Decision]:
        """Make some decisions, with or without clocks on the stages."""
        done = []
        for _ in range(decisions):
            before = dict(self.spent)
            self._simulation._stages = self._timed if in_stages else self._plain
            done.append(self._decide())
            self._simulation._stages = self._plain
            if not done[-1].counts:
                self.spent.clear()
                self.spent.update(before)
        return done

    def close(self) -> None:
        """Give back what the simulations hold."""
        self.env.close()

    def _decide(self) -> Decision:
        self._now, self._aside = Decision(), 0.0
        begin = time.process_time()
        step = self.env.step(self._actions)
        now = self._now
        now.seconds = time.process_time() - begin - self._aside
        now.counts = (
            len(now.social) == PERIOD
            and not step.reset.any()
            and bool(step.alive.all())
            and min(now.slowest) > SLOWEST
            and all(self._is_within(social).all() for social in now.social)
        )
        world = self._runner.world
        over = ~self._is_within(self._social()) | ~step.alive.all(axis=1)
        if not now.counts:
            over |= (self._speeds().min(axis=1) <= SLOWEST) & (world.step > UNDER_WAY)
        now.traffic = [self._traffic(row) for row in range(self.env.num_envs)]
        now.begun = self._begun(set(np.flatnonzero(step.reset).tolist()), set(np.flatnonzero(over).tolist()))
        return now

    def _watched(self, *given: Any, **more: Any) -> Frame:
        """Step and record all poses; recording is not timed."""
        frame, env_mask = self._advance(*given, **more), given[1]
        begin = time.process_time()
        self._now.poses.append([self._poses(row) for row in range(len(env_mask))])
        self._now.social.append(self._social())
        self._now.slowest.append(float(self._speeds().min()) if env_mask.all() else -1.0)
        self._aside += time.process_time() - begin
        return frame

    def _begun(self, reset: set[int], over: Collection[int] = ()) -> dict[int, Beginning]:
        """Reset simulations until all have as many vehicles as asked for; return the episodes that begin."""
        begun = reset | {*over}
        for _ in range(MOST_RESETS):
            if over:
                begin = time.process_time()
                self.env.recreate({row: TrafficError("out of range") for row in over})
                self.resets.append((time.process_time() - begin) / len(over))
            within = self._is_within(self._social())
            over = {row for row in begun if not within[row]}
            if not over:
                return {row: self._beginning(row) for row in begun}
        raise TrafficError(f"{MOST_RESETS} episodes in a row had too many or too few vehicles", place="perf")

    def _beginning(self, row: int) -> Beginning:
        return Beginning(self.env.episodes[row], self._poses(row), self._traffic(row))

    def _traffic(self, row: int) -> set[str]:
        return {*self._drivers[row]._driven}

    def _is_within(self, social: np.ndarray) -> np.ndarray:
        low, high = self._band
        return (low <= social) & (social <= high)

    def _social(self) -> np.ndarray:
        return (self._runner.world.vehicles.owner == Owner.TRAFFIC).sum(axis=1)

    def _speeds(self) -> np.ndarray:
        world = self._runner.world
        slots = world.agents.slot[:, : world.egos]
        speeds = np.take_along_axis(world.vehicles.speed, np.maximum(slots, 0), axis=1)
        return np.where(slots >= 0, speeds, -1.0)

    def _poses(self, row: int) -> list[Pose]:
        world = self._runner.world
        vehicles, slots = world.vehicles, np.maximum(world.agents.slot[row, : world.egos], 0)
        heading = vehicles.heading[row, slots]
        ahead = np.stack([np.cos(heading), np.sin(heading)], -1) * vehicles.length[row, slots, None] / 2
        x, y = (vehicles.position[row, slots] + ahead).T.tolist()
        angle = [compass_from_heading(each) for each in heading.tolist()]
        return [*zip(x, y, angle, np.maximum(vehicles.speed[row, slots], 0.0).tolist(), strict=True)]


@dataclass
class Result:
    """One line of the table."""

    name: str
    worlds: int
    egos: int
    social: list[np.ndarray] = field(default_factory=list)
    slowest: list[float] = field(default_factory=list)
    bare_social: list[float] = field(default_factory=list)
    ours: list[float] = field(default_factory=list)
    """Time of each counted decision [s]."""
    bare: list[float] = field(default_factory=list)
    """Time of the bare loop for the same steps [s]."""
    timed: list[float] = field(default_factory=list)
    """Time of each decision with clocks on the stages [s]."""
    reset: float = 0.0
    spent: dict[str, float] = field(default_factory=dict)
    wall: float = 0.0
    processor: float = 0.0

    def each(self, seconds: float, decisions: int) -> float:
        """Return microseconds for a step of one simulation."""
        return 1e6 * seconds / (decisions * PERIOD * self.worlds)

    def take(self, decision: Decision, *, in_stages: bool) -> None:
        """Count a decision."""
        (self.timed if in_stages else self.ours).append(decision.seconds)
        self.social += decision.social
        self.slowest += decision.slowest

    def check(self, social: int) -> None:
        """Make sure that every counted step was as it should be.

        Raises:
            SmartsError: One was not.
        """
        counts = np.array(self.social)
        if not len(counts) or min(self.slowest) <= SLOWEST or np.abs(counts - social).max() > BAND * social:
            raise SmartsError("a step counts that should not", place=self.name)

    def row(self) -> str:
        """Return the line of the speed table."""
        ours = self.each(sum(self.ours), len(self.ours))
        bare = self.each(sum(self.bare), len(self.bare))
        counts = np.array(self.social)
        cells = (
            *(self.name, self.worlds, self.egos),
            f"{counts.mean():.1f} ({counts.min()} to {counts.max()})",
            f"{np.mean(self.bare_social):.1f}",
            f"{min(self.slowest):.1f}",
            f"{len(self.ours) * PERIOD * self.worlds}",
            f"{1e6 / ours:.0f}",
            f"{1e6 / ours * self.egos:.0f}",
            f"{1e6 / bare:.0f}",
            f"{ours / bare:.2f}",
            f"{1e6 / ours * DT:.0f}",
            f"{1e6 / ours / (PERIOD * self.worlds):.0f}",
            f"{self.reset * 1e3:.0f}",
            f"{100 * self.processor / self.wall:.0f}%",
        )
        return "| " + " | ".join(map(str, cells)) + " |"


HEADER = (
    *("scenario", "B", "egos", "social vehicles", "in the bare loop", "slowest ego [m/s]"),
    *("counted env-steps", "env-steps/s", "agent-steps/s", "bare env-steps/s", "ratio"),
    *("simulated s per processor s", "env.step calls/s"),
    *("a reset [ms]", "share of the core"),
)


def measure(name: str, source: Path, worlds: int, egos: int, social: int, decisions: int) -> Result:
    """Drive ours and the bare loop in turn until as many decisions count as asked for."""
    result = Result(name, worlds, egos)
    ours, bare = Run(source, worlds, egos, social), BareLoop(worlds, egos)
    try:
        _begin_bare(bare, ours.begin())
        for _ in range(2):
            _follow(bare, ours.block(BLOCK, in_stages=False), result)
        ours.resets.clear()
        for record in (result.bare, result.bare_social):
            record.clear()
        wall, processor = time.perf_counter(), time.process_time()
        for number in range(100 * decisions):
            in_stages = number % 4 == 3
            done = ours.block(BLOCK, in_stages=in_stages)
            for decision in done:
                if decision.counts:
                    result.take(decision, in_stages=in_stages)
            _follow(bare, done, result)
            if len(result.ours) >= decisions and result.timed:
                break
        result.wall, result.processor = time.perf_counter() - wall, time.process_time() - processor
    finally:
        ours.close()
        bare.close()
    result.reset = float(np.mean(ours.resets)) if ours.resets else float("nan")
    result.spent = dict(ours.spent)
    result.check(social)
    return result


def _begin_bare(bare: BareLoop, begun: dict[int, Beginning]) -> None:
    for row, beginning in begun.items():
        bare.reset(row, beginning)


def _follow(bare: BareLoop, done: Sequence[Decision], result: Result) -> None:
    """Let the bare loop drive what ours has driven."""
    for decision in done:
        # Where an episode has ended an ego may be missing; what is left of it is not driven.
        begin = time.process_time()
        for poses in decision.poses:
            bare.step(poses, decision.begun)
        if decision.counts:
            result.bare.append(time.process_time() - begin)
            result.bare_social.append(bare.vehicles())
        bare.keep(decision.traffic, decision.begun)
        _begin_bare(bare, decision.begun)


def stage_table(results: Sequence[Result]) -> str:
    """Return microseconds for each stage and step of one simulation, as a Markdown table."""
    columns = []
    for result in results:
        count, whole = len(result.timed), sum(result.timed)
        column = {stage: result.each(spent, count) for stage, spent in result.spent.items()}
        column["the rest: adapter, episodes, calls"] = result.each(whole - sum(result.spent.values()), count)
        columns.append(column)
    stages = sorted({stage for column in columns for stage in column}, key=lambda s: -columns[0].get(s, 0.0))
    heads = [f"{result.name}, B = {result.worlds}" for result in results]
    lines = [_line(["stage [us]", *heads]), "|---" * (len(heads) + 1) + "|"]
    lines += [_line([stage, *(f"{column.get(stage, 0.0):.0f}" for column in columns)]) for stage in stages]
    lines.append(_line(["step", *(f"{sum(column.values()):.0f}" for column in columns)]))
    return "\n".join(lines)


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    """Measure what the command line asks for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenarios", nargs="+", default=["loop", "intersection"])
    parser.add_argument("--worlds", type=int, nargs="+", default=[1, 8])
    parser.add_argument("--egos", type=int, default=4)
    parser.add_argument("--social", type=int, nargs="+", default=[25])
    parser.add_argument("--decisions", type=int, default=200, help="that count, at least (default 200)")
    options = parser.parse_args()
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    results = []
    print(_line(HEADER), "|---" * len(HEADER) + "|", sep="\n")
    try:
        with tempfile.TemporaryDirectory() as folder:
            for name in options.scenarios:
                for social in options.social:
                    source = scene(name, social, options.egos, Path(folder))
                    for worlds in options.worlds:
                        count = max(options.decisions // worlds, 40)
                        results.append(measure(name, source, worlds, options.egos, social, count))
                        print(results[-1].row(), flush=True)
    except SmartsError as error:
        sys.exit(f"perf.step: {error}")
    print(f"\nOne step is {DT} s.\n\n{stage_table(results)}")


if __name__ == "__main__":
    main()
