"""What hand-overs of vehicles between SUMO and agents do to the vehicles, and what they cost.

    python -m perf.handovers                                     # 10,000 hand-overs, all scenarios and models
    python -m perf.handovers --handovers 200 --scenarios city --models kinematic
    python -m perf.handovers --handovers 300 --scenarios FOLDER  # with recorded traffic, in place of SUMO's

Vehicles of mixed traffic (cars, buses, trucks) are taken over wherever they are, driven by the fallback
controller for 1 to 8 s, and handed back as soon as the gate opens. Beside each run plays another
with the same seed and no hand-over. Errors are differences of
a step from a steady continuation of the step before: along and across the vehicle's course [m], of its
heading [rad], and of its speed [m/s]; beside them those of traffic that no agent has touched. The last table
has all runs, with hand-overs / without.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from perf.handover_errors import Tally, print_tally, step_errors
from perf.handover_safety import Safety, Watch, print_safety
from smarts.agents import AgentInterface, DoneCriteria, PooledAgents
from smarts.sim.assembly import Assembly, assemble
from smarts.sstudio import build_scenario
from smarts.types.actions import ActionSpaceType
from smarts.types.agent_states import UNSET, AgentStatus
from smarts.types.episode import AgentStart, EpisodeStart
from smarts.types.mission import AgentMission
from smarts.types.transfers import Reason, Transfer
from smarts.types.vehicles import Owner, VehicleKind

SCENARIOS = ("city", "intersection", "roundabout", "on_ramp_merge", "off_ramp_merge")
Model = Literal["kinematic", "bullet"]
MODELS: tuple[Model, ...] = ("kinematic", "bullet")
STEPS = 600
"""Steps of an episode."""
HELD = 16
"""Most vehicles at a time that agents drive."""
LONGEST_WAIT = 5.0
"""A vehicle that cannot be taken over for so long is left alone [s]."""
BIG = """<vType id="a-bus" vClass="bus" length="12" width="2.5" accel="1.2" decel="4" emergencyDecel="4.5"/>
    <vType id="a-truck" vClass="truck" length="7.1" width="2.4" accel="1.3" decel="4" emergencyDecel="4.5"/>
    <vTypeDistribution """

NO_ENDS = DoneCriteria(
    collision=True,
    off_road=False,
    off_route=False,
    on_shoulder=False,
    wrong_way=False,
    not_moving=False,
)


def with_big_vehicles(start: EpisodeStart, folder: Path) -> EpisodeStart:
    """Return an episode in whose traffic a fourth of the vehicles are buses and trucks."""
    files = []
    for number, file in enumerate(start.traffic.routes):
        text = file.read_text().replace("<vTypeDistribution ", BIG, 1)
        text = text.replace('probabilities="0.5 0.5"', 'probabilities="0.37 0.37 0.13 0.13"')
        text = text.replace('" probabilities=', ' a-bus a-truck" probabilities=')
        files.append(folder / f"{start.scenario}-{number}.rou.xml")
        files[-1].write_text(text)
    return replace(start, traffic=replace(start.traffic, routes=tuple(files)))


@dataclass
class Hold:
    """A vehicle in the hands of an agent, or on its way there."""

    number: int
    slot: int
    generation: int
    until: int
    """Step at which it is to be released."""
    begun: int
    agent_id: int = UNSET
    asked: int = UNSET
    """Step at which its release was asked for."""


class Run:
    """One simulation in which vehicles change hands."""

    def __init__(self, parts: Assembly, generator: np.random.Generator, tally: Tally) -> None:
        self.parts, self.tally = parts, tally
        self.world = parts.simulation.world
        self.watch = Watch(self.world.dt)
        self.generator = generator
        self.holds: list[Hold] = []
        self.touched: set[tuple[int, int]] = set()
        """Vehicles (slot, generation) that an agent has driven."""
        self._given_back: dict[int, int] = {}
        self._mask = np.ones(1, np.bool_)
        self._nobody = np.zeros(self.world.agents.slot.shape, np.bool_)

    def play(self, steps: int, most: int) -> int:
        """Make steps until some hand-overs are done; return how many were made."""
        made = 0
        for _ in range(steps):
            room = HELD - len(self.holds)
            if made + 2 * len(self.holds) < most and room and self.generator.random() < 0.7:
                self._want(room)
            self._ask()
            made += self.step()
        self._count_the_rest()
        return made

    def step(self) -> int:
        """Make a step, measure it; return how many vehicles changed hands."""
        before = self._copy()
        frame = self.parts.simulation.step(self.parts.actions, self._mask, self._nobody)
        if frame.failures:
            raise next(iter(frame.failures.values()))
        self.tally.steps += 1
        self.watch.take(frame)
        return self._measure(before)

    def _copy(self) -> dict[str, NDArray]:
        vehicles = self.world.vehicles
        names = ("alive", "generation", "owner", "position", "heading", "speed", "lateral_speed", "yaw_rate")
        return {name: getattr(vehicles, name)[0].copy() for name in names}

    def _want(self, room: int) -> None:
        """Choose vehicles of traffic to take over, and announce an agent for each."""
        vehicles, row = self.world.vehicles.of(0), 0
        busy = {hold.slot for hold in self.holds}
        free = [
            slot
            for slot in np.flatnonzero(vehicles.alive & (vehicles.owner == Owner.TRAFFIC)).tolist()
            if slot not in busy and (slot, int(vehicles.generation[slot])) not in self.touched
        ]
        if not free:
            return
        slot = int(self.generator.choice(free))
        pose = (*vehicles.position[slot].tolist(), float(vehicles.heading[slot]))
        start = AgentStart(
            f"agent-of-{self.world.registry.name(row, slot)}",
            pose,
            float(vehicles.speed[slot]),
            self._mission(slot),
            interface=0,
            collision_time=2.0,
        )
        number = self.parts.pool.announce(row, start)
        now = int(self.world.step[0])
        until = now + int(self.generator.integers(10, 80))
        self.holds.append(Hold(number, slot, int(vehicles.generation[slot]), until, now))

    def _mission(self, slot: int) -> AgentMission:
        """Return the mission to follow the vehicle's own route."""
        graph = self.parts.scene.atlas.graphs[self.world.map[0]]
        number = int(self.world.vehicles.route[0, slot])
        edges = self.world.routes.edges(0, number).tolist() if number >= 0 else ()
        return AgentMission(route=tuple(graph.edge_ids[edge] for edge in edges))

    def _ask(self) -> None:
        """Propose to take over the vehicles that are wanted, and ask for the release of others."""
        now, proposed = int(self.world.step[0]), []
        for hold in self.holds:
            if hold.agent_id == UNSET:
                proposed.append(
                    Transfer(
                        0,
                        hold.slot,
                        hold.generation,
                        Owner.TRAFFIC,
                        UNSET,
                        Owner.AGENT,
                        UNSET,
                        Reason.TAKE,
                        hold.number,
                    )
                )
            elif hold.asked == UNSET and now >= hold.until:
                hold.asked = now
                self.world.agents.release_step[0, hold.agent_id] = now
        self.parts.ownership.submit(proposed)

    def _measure(self, before: dict[str, NDArray]) -> int:
        now = self._copy()
        errors = step_errors(before, now, self.world.dt)
        same = before["alive"] & now["alive"] & (before["generation"] == now["generation"])
        changed = self._follow_holds(before, now, errors)
        is_traffic = same & (now["owner"] == Owner.TRAFFIC) & (before["owner"] == Owner.TRAFFIC)
        untouched = [
            slot
            for slot in np.flatnonzero(is_traffic).tolist()
            if (slot, int(now["generation"][slot])) not in self.touched
        ]
        self.tally.add("traffic", errors[untouched])
        for slot, generation in self._given_back.items():
            if same[slot] and now["generation"][slot] == generation:
                self.tally.add("release, step after", errors[[slot]])
        self._given_back = self._just_back
        return changed

    def _follow_holds(self, before: dict[str, NDArray], now: dict[str, NDArray], errors: NDArray) -> int:
        """Note which vehicles have changed hands in the step; return how many."""
        changed, self._just_back, step = 0, {}, int(self.world.step[0])
        agents, left = self.world.agents, []
        for hold in self.holds:
            slot = hold.slot
            alive = now["alive"][slot] and now["generation"][slot] == hold.generation
            owner = now["owner"][slot] if alive else Owner.NOBODY
            if hold.agent_id == UNSET:
                if owner == Owner.AGENT:
                    hold.agent_id = int(np.flatnonzero(agents.slot[0] == slot)[0])
                    self.touched.add((slot, hold.generation))
                    self._note_take(slot, errors)
                    changed += 1
                elif owner == Owner.NOBODY or (step - hold.begun) * self.world.dt > LONGEST_WAIT:
                    continue
            elif owner == Owner.TRAFFIC:
                self.tally.add("release", errors[[slot]])
                self._just_back[slot] = hold.generation
                self.tally.waits.append((step - hold.asked) * self.world.dt if hold.asked != UNSET else 0.0)
                self.tally.ends["released"] += 1
                changed += 1
                continue
            elif owner == Owner.NOBODY:
                harmed = bool(agents.harmed[0, hold.agent_id])
                self.tally.ends["removed: collision" if harmed else "arrived"] += 1
                continue
            left.append(hold)
        self.holds = left
        return changed

    def _note_take(self, slot: int, errors: NDArray) -> None:
        vehicles, roads = self.world.before.of(0), self.parts.scene.atlas.graphs[self.world.map[0]]
        lane = int(vehicles.lane[slot])
        place = "on the lane"
        if lane >= 0 and roads.is_internal[lane]:
            place = "in a junction"
        elif abs(vehicles.lane_offset[slot]) > 0.4:
            place = "between lanes"
        self.tally.places[place] += 1
        self.tally.kinds[VehicleKind(int(vehicles.kind[slot])).name.lower()] += 1
        self.tally.add("take", errors[[slot]])

    def _count_the_rest(self) -> None:
        """Count the holds that have not ended with the run."""
        now = int(self.world.step[0])
        for hold in self.holds:
            if hold.agent_id != UNSET:
                status = AgentStatus(int(self.world.agents.state[0, hold.agent_id])).name.lower()
                harmed = bool(self.world.agents.harmed[0, hold.agent_id])
                self.tally.ends["obstacle at the end" if harmed else f"{status} at the end"] += 1
                waited = (now - hold.asked) * self.world.dt if hold.asked != UNSET else 0.0
                if waited > 10.0 and not harmed:
                    self.tally.waits.append(np.inf)
        self.tally.refused += self.parts.ownership.refused[0]
        self.tally.departed += self.parts.ownership.departed[0]
        self.watch.end(self.parts.ownership)


def run_scenario(
    name: str,
    model: Model,
    handovers: int,
    seed: int,
    tally: Tally,
    folder: Path,
    safety: Safety | None = None,
) -> int:
    """Make hand-overs in one scenario, and the same runs without; return how many were made."""
    safety = safety or Safety()
    interface = AgentInterface(action=ActionSpaceType.Lane, vehicle_model=model, done_criteria=NO_ENDS)
    made, episode = 0, 0
    built = build_scenario(name)
    built = built.with_traffic(sorted(built.traffic, key="random_social_vehicles".__ne__)[:1])
    parts = assemble([built], [], pool=[PooledAgents(interface, HELD)], worlds=1, seed=seed)
    try:
        while made < handovers:
            start = with_big_vehicles(parts.schedule.start(0, episode), folder)
            parts.simulation.reset({0: start})
            generator = np.random.Generator(np.random.Philox(seed + 1000 * episode))
            run = Run(parts, generator, tally)
            made += run.play(STEPS, handovers - made)
            safety.driven.append(run.watch)
            plain = Tally()
            parts.simulation.reset({0: start})
            run = Run(parts, generator, plain)
            run.play(STEPS, 0)
            safety.plain.append(run.watch)
            tally.errors["traffic, no hand-overs"] += plain.errors["traffic"]
            episode += 1
    finally:
        parts.simulation.close()
    return made


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the measurements that the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--handovers", type=int, default=10_000)
    parser.add_argument("--scenarios", nargs="+", default=SCENARIOS)
    parser.add_argument("--models", nargs="+", default=MODELS, choices=MODELS)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args(arguments)
    each = -(-given.handovers // (len(given.scenarios) * len(given.models)))
    whole, safety = Tally(), Safety()
    with TemporaryDirectory() as folder:
        for model in given.models:
            for scenario in given.scenarios:
                tally, begin = Tally(), time.perf_counter()
                made = run_scenario(scenario, model, each, given.seed, tally, Path(folder), safety)
                seconds = time.perf_counter() - begin
                print(f"\n{scenario}, {model}: {made} hand-overs in {tally.steps} steps, {seconds:.0f} s")
                print_tally(tally)
                whole.join(tally)
    print("\nall of them; worst allowed: take 0.05, 0.25, -, 0.8; release 0.05, 0.15, 0.05, 0.6")
    print_tally(whole)
    print_safety(safety)


if __name__ == "__main__":
    main()
