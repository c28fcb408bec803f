"""Count the manoeuvres of the zoo's overtaking, cut-in and U-turn agents in traffic, and their contacts.

    python -m perf.zoo_manoeuvres [AGENT...] [--episodes 20] [--seed 42] [--set planner=sumo]

The agents drive the egos of scenarios in which their manoeuvre is possible; episode k is the same for all
agents and planners until an ego acts. Printed for each agent and scenario: the egos and how they ended
(collisions with anything, whoever is to blame; some still drive after a minute); and

- overtaking: vehicles passed, less those that passed the ego, a kilometre; and the share of egos that began a
  manoeuvre that are in a lane of their first one's place across the road at the end;
- cut-in: changes closely (below 15 m) in front of another vehicle: their number, and the median and least gap
  when the ego's centre is over the line;
- U-turn: egos that turned round, and how long that took from 30 to 150 degrees.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from benchmark.cli.zoo import options_of
from benchmark.running.zoo_contract import ZooDrive
from smarts.agents.policy import BatchAgent
from smarts.geometry.frames import wrap_angle
from smarts.types.events import Outcome
from smarts.zoo import make_agent, make_spec

SCENES = {
    "overtaking-v0": {"overtaking": 2, "loop": 4},
    "cut-in-v0": {"overtaking": 2, "loop": 4},
    "u-turn-v0": {"intersection": 4},
}
"""Agent -> scenario -> egos."""
TRAFFIC = "random_social_vehicles"
WORLDS = 4
CLOSE = 15.0
"""Gap at which a change is a cut-in [m]."""
BEGUN, ROUND = np.radians([30.0, 150.0])
"""Angles to the first heading between which a U-turn is timed."""


class Now(NamedTuple):
    """An ego and the vehicles on its road, at one step."""

    lane: int
    across: int
    """Of its lane across the road, 0 is the rightmost; -1 in a junction."""
    edge: int
    place: float
    """Along its lane [m]."""
    heading: float
    travelled: float
    """In this step [m]."""
    length: float
    others: dict[int, tuple[int, float, float]]
    """Slot -> lane, place along it [m], length [m] of the others on the road."""


class Counts:
    """What one ego has done."""

    def __init__(self) -> None:
        self.passed, self.way = 0, 0.0
        self.gaps: list[float] = []
        self.turned = float("nan")
        """Time from 30 to 150 degrees [s]."""
        self._first: Now | None = None
        self._last: Now | None = None
        self._step = self._begun = 0
        self.has_changed = self.is_back = False

    def take(self, now: Now) -> None:
        """Take in a step."""
        first, last = self._first or now, self._last
        self._first, self._last, self._step = first, now, self._step + 1
        self.way += now.travelled
        angle = abs(float(wrap_angle(now.heading - first.heading)))
        self._begun = self._step if angle < BEGUN else self._begun
        if angle > ROUND and np.isnan(self.turned):
            self.turned = 0.1 * (self._step - self._begun)
        if now.across >= 0:
            self.is_back = now.across == first.across
        if last is None or last.edge != now.edge:
            return
        for slot in now.others.keys() & last.others.keys():
            was = last.others[slot][1] - last.place
            after = now.others[slot][1] - now.place
            self.passed += int(was > 0.0 >= after) - int(was <= 0.0 < after)
        if now.lane != last.lane:
            self.has_changed = True
            behind = [
                now.place - place - 0.5 * (now.length + length)
                for lane, place, length in now.others.values()
                if lane == now.lane and place < now.place
            ]
            self.gaps += [min(behind)] if behind and min(behind) < CLOSE else []


def look(drive: ZooDrive, row: int, ego: int) -> Now:
    """Return what one ego's road looks like."""
    world, roads = drive.world, drive.scene.atlas.roads
    vehicles, slot = world.vehicles, int(world.agents.slot[row, ego])
    base = roads.lane_base[world.map[row]]
    lane, alive = int(vehicles.lane[row, slot]), vehicles.alive[row] & (vehicles.lane[row] >= 0)
    edges = roads.lane_edge[base + vehicles.lane[row]]
    edge = int(edges[slot])
    others = {
        each: (
            int(vehicles.lane[row, each]),
            float(vehicles.lane_position[row, each]),
            float(vehicles.length[row, each]),
        )
        for each in np.flatnonzero(alive & (edges == edge)).tolist()
        if each != slot
    }
    place, heading = float(vehicles.lane_position[row, slot]), float(vehicles.heading[row, slot])
    length = float(vehicles.length[row, slot])
    across = -1 if roads.lane_inside[base + lane] else int(roads.lane_index[base + lane])
    return Now(lane, across, edge, place, heading, 0.1 * float(vehicles.speed[row, slot]), length, others)


def drive_all(
    name: str, scenario: str, options: dict[str, Any], episodes: int, seed: int, steps: int = 600
) -> tuple[list[Counts], list[Outcome]]:
    """Drive the egos of some episodes; return what they did and how they ended."""
    spec, agent = make_spec(name, **options), make_agent(name, **options)[0]
    assert isinstance(agent, BatchAgent)
    egos, outcomes = [], []
    count = SCENES[name][scenario]
    with ZooDrive(
        name, spec, agent, scenario, egos=count, worlds=WORLDS, seed=seed, traffic=TRAFFIC
    ) as drive:
        for episode in range(episodes // WORLDS):
            drive.reset(episode, worlds=range(episode * WORLDS, (episode + 1) * WORLDS))
            counts = {place: Counts() for place in np.ndindex(WORLDS, drive.egos)}
            for _ in range(steps):
                for row, ego in np.argwhere(drive.active).tolist():
                    counts[row, ego].take(look(drive, row, ego))
                drive.step()
                if not drive.active.any():
                    break
            egos += counts.values()
            outcomes += drive.outcomes.values()
    return egos, outcomes


def measures(name: str, egos: Iterable[Counts]) -> str:
    """Return what an agent's manoeuvre is measured by."""
    egos = [*egos]
    if name == "overtaking-v0":
        passed, way = sum(each.passed for each in egos), sum(each.way for each in egos)
        changed = [each.is_back for each in egos if each.has_changed]
        return f"passed {1e3 * passed / way:.1f} a km, back {sum(changed)} of {len(changed)}"
    if name == "cut-in-v0":
        gaps = [gap for each in egos for gap in each.gaps]
        least = f", gap median {np.median(gaps):.1f} m, least {min(gaps):.1f} m" if gaps else ""
        return f"{len(gaps)} cut-ins{least}"
    times = [each.turned for each in egos if not np.isnan(each.turned)]
    took = f", median {np.median(times):.1f} s, longest {max(times):.1f} s" if times else ""
    return f"turned round {len(times)}{took}"


def main() -> None:
    """Print a line for each agent and scenario."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("agents", nargs="*", default=[*SCENES], metavar="AGENT")
    parser.add_argument("--episodes", type=int, default=20, help=f"a multiple of {WORLDS}")
    parser.add_argument("--seed", type=int, default=42)
    parser.add_argument("--steps", type=int, default=600, help="of an episode, at most")
    parser.add_argument("--set", nargs="*", default=[], metavar="OPTION=VALUE", help="options of the agents")
    asked = parser.parse_args()
    if asked.episodes < WORLDS or asked.episodes % WORLDS:
        parser.error(f"--episodes is {asked.episodes}: give a multiple of {WORLDS}")
    options = options_of(asked.set)
    for name in asked.agents:
        for scenario in SCENES[name]:
            egos, outcomes = drive_all(name, scenario, options, asked.episodes, asked.seed, asked.steps)
            ends = [f"{outcomes.count(each)} {each.name.lower()}" for each in sorted({*outcomes})]
            found = f"{len(egos)} egos ({', '.join(ends)}); {measures(name, egos)}"
            print(f"{name} in {scenario}: {found}", flush=True)


if __name__ == "__main__":
    main()
