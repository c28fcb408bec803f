"""What bubbles on recorded traffic do to its vehicles: hand-overs, jumps, losses, vehicles out per minute.

    python -m perf.recorded_bubbles FOLDER [--seconds 60]

FOLDER is what `smarts-bench data import` wrote. Agents of the zoo drive in squares of 40, 80 and 120 m about
the middle of the map. Errors are those of `perf.handovers`; the last table has all runs, with bubbles /
without. Vehicles that leave are counted from the 10th second on, when those of the begin have passed.
"""

from __future__ import annotations

import argparse
import shutil
from contextlib import closing, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from perf.handover_errors import Tally, print_errors, step_errors
from perf.handover_safety import Safety, Watch, print_safety
from perf.handovers import NO_ENDS
from smarts.agents import AgentInterface
from smarts.arrays import Bools
from smarts.env.casting import cast_of
from smarts.env.runner import EpisodeKey, SimulationRunner
from smarts.sim.assembly import Assembly, assemble
from smarts.sstudio.build import build_scenario
from smarts.types.actions import ActionSpaceType
from smarts.types.frame import Frame
from smarts.types.transfers import Reason
from smarts.types.vehicles import Owner

POLICIES = ("idm-v0", "mobil-v0", "keep-lane-v0")
SIDES = (40, 80, 120)
"""Side lengths of the bubbles [m]."""
BEGUN = 10.0
"""Time from which on vehicles out are counted [s]."""
SCENARIO = """
from pathlib import Path

from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

scenario = t.Scenario(
    traffic={{"recorded": t.Traffic([], engine="Recorded", recording=t.Recording("."))}},
    ego_missions=[t.EndlessMission(begin=({edge!r}, 0, "base"), start_time=10_000)],
    bubbles=[{bubbles}],
)
gen_scenario(scenario, output_dir=Path(__file__).parent)
"""
BUBBLE = """
t.Bubble(
    t.PositionalZone({middle}, ({side}, {side})),
    t.SocialAgentActor("driver", "smarts.zoo:{policy}"),
    margin=10,
)
"""


class OverError(Exception):
    """The time is over."""


class Listener:
    """Measures each step of one simulation."""

    def __init__(self, parts: Assembly, steps: int, tally: Tally) -> None:
        self.world, self.steps, self.tally = parts.simulation.world, steps, tally
        self.watch = Watch(self.world.dt)
        self.out = 0
        """Vehicles that have left from the 10th second on."""
        self._before: dict[str, NDArray] = {}
        self._touched: set[tuple[int, int]] = set()
        self._given_back: set[int] = set()

    def reset(self, egos: Bools) -> None:
        """See `StepListener`."""

    def collect(self, frame: Frame, is_last: bool) -> None:
        """See `StepListener`."""
        vehicles = self.world.vehicles
        names = ("alive", "generation", "owner", "position", "heading", "speed", "lateral_speed", "yaw_rate")
        before, now = self._before, {name: getattr(vehicles, name)[0].copy() for name in names}
        self._before = now
        self.watch.take(frame)
        self.tally.steps += 1
        if before:
            self._measure(frame, before, now)
        if self.world.step[0] >= self.steps:
            raise OverError

    def _measure(self, frame: Frame, before: dict[str, NDArray], now: dict[str, NDArray]) -> None:
        errors, moved = step_errors(before, now, self.world.dt), {}
        for done in frame.transfers:
            moved[done.transfer.slot] = Reason(done.transfer.reason)
        back = {slot for slot, reason in moved.items() if reason == Reason.RELEASE}
        self._touched |= {
            (slot, int(now["generation"][slot])) for slot, why in moved.items() if why == Reason.TAKE
        }
        if self.world.time[0] > BEGUN:
            gone = before["alive"] & ~(now["alive"] & (now["generation"] == before["generation"]))
            self.out += int(gone.sum())
        same = before["alive"] & now["alive"] & (before["generation"] == now["generation"])
        for slot in np.flatnonzero(same).tolist():
            what = "driven" if now["owner"][slot] == Owner.AGENT else "traffic"
            if moved.get(slot) in (Reason.TAKE, Reason.RELEASE):
                what = moved[slot].name.lower()
            elif slot in self._given_back:
                what = "release, step after"
            elif what == "traffic" and (slot, int(now["generation"][slot])) in self._touched:
                what = "traffic, given back"
            self.tally.add(what, errors[[slot]])
        self._given_back = back


def run(folder: Path, bubbles: str, seconds: float, tally: Tally) -> tuple[Watch, float]:
    """Play the recording once, with bubbles or none; return also how many vehicles leave in a minute."""
    edge = next(edge for edge in build_scenario(folder).roads().edge_ids if not edge.startswith(":"))
    (folder / "scenario.py").write_text(SCENARIO.format(edge=edge, bubbles=bubbles))
    built = build_scenario(folder)
    interface = AgentInterface(action=ActionSpaceType.Lane, vehicle_model="kinematic", done_criteria=NO_ENDS)
    parts = assemble([built], [interface], cast=cast_of([built]))
    listener = Listener(parts, round(seconds / parts.simulation.world.dt), tally)
    with closing(SimulationRunner(parts, [listener], period=10)) as runner:
        with suppress(OverError):
            runner.reset({0: EpisodeKey(0, 0, 42)})
        listener.watch.end(parts.ownership)
    return listener.watch, 60.0 * listener.out / (seconds - BEGUN)


def main() -> None:
    """Run all policies in all bubbles, and print what was measured."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder")
    parser.add_argument("--seconds", type=float, default=60.0)
    given = parser.parse_args()
    whole, safety, rows = Tally(), Safety(), []
    with TemporaryDirectory() as temporary:
        folder = Path(temporary, "recorded")
        shutil.copytree(given.folder, folder, ignore=shutil.ignore_patterns("build"))
        roads = build_scenario(folder).roads()
        middle = tuple((0.5 * (roads.point_xy.min(axis=0) + roads.point_xy.max(axis=0))).round(1).tolist())
        plain, out_without = run(folder, "", given.seconds, Tally())
        for policy in POLICIES:
            for side in SIDES:
                tally = Tally()
                bubble = BUBBLE.format(middle=middle, side=side, policy=policy)
                watch, out = run(folder, bubble, given.seconds, tally)
                safety.driven.append(watch)
                safety.plain.append(plain)
                whole.join(tally)
                rows.append((policy, side, len(watch.transfers), out))
    print("\nworst allowed: take 0.05, 0.25, -, 0.8; release 0.05, 0.15, 0.05, 0.6")
    print_errors(whole)
    print_safety(safety)
    print(f"\n{'policy':14}{'side [m]':>10}{'hand-overs':>12}{'out per minute':>16}{'without':>9}")
    for policy, side, count, out in rows:
        print(f"{policy:14}{side:10}{count:12}{out:16.1f}{out_without:9.1f}")


if __name__ == "__main__":
    main()
