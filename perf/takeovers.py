"""What it costs when agents take vehicles of traffic over, and to drive these.

    python -m perf.takeovers                          # in the city, 300 vehicles, 100 agents
    python -m perf.takeovers --agents 16 --vehicles 60 --scenario intersection --steps 100

A take-over is timed from the announcement of the agent with its mission to the end of the step in which the
vehicle changes hands, less a step of the same agents without: along routes that are new to the run, and along
routes that another agent has had. A further agent is timed by two simulations that begin equally and make
their steps in turn: in one, agents keep the lanes of the vehicles that they have taken over.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Literal

import numpy as np

from smarts.agents import AgentInterface, DoneCriteria, PooledAgents
from smarts.sim.assembly import assemble
from smarts.sim.hold_missions import HoldMissions
from smarts.sstudio import build_scenario
from smarts.types.actions import ActionSpaceType
from smarts.types.agent_states import UNSET
from smarts.types.episode import AgentStart
from smarts.types.transfers import Reason, Transfer, transfers
from smarts.types.vehicles import Owner

Model = Literal["kinematic", "bullet"]
MODELS: tuple[Model, ...] = ("kinematic", "bullet")
BATCH = 8
"""Vehicles that are taken over in one step."""
AFTER = 3
"""Steps without a take-over that a step with some is compared with."""
NO_ENDS = DoneCriteria(
    collision=False, off_road=False, off_route=False, on_shoulder=False, wrong_way=False, not_moving=False
)


class Town:
    """A simulation of one scenario's traffic, in which agents take vehicles over and keep their lanes."""

    def __init__(self, scenario: str, model: Model, agents: int, vehicles: int, seed: int) -> None:
        interface = AgentInterface(action=ActionSpaceType.Lane, vehicle_model=model, done_criteria=NO_ENDS)
        built = build_scenario(scenario).with_traffic(["random_social_vehicles"])
        self.parts = assemble([built], [], pool=[PooledAgents(interface, agents)], worlds=1, seed=seed)
        self.world, self._limit = self.parts.simulation.world, vehicles
        self._missions = HoldMissions(self.world, self.parts.scene.routes)
        self._mask = np.ones(1, np.bool_)
        self._nobody = np.zeros(self.world.agents.slot.shape, np.bool_)

    def begin(self, episode: int) -> None:
        """Begin an episode with a limited number of vehicles."""
        start = self.parts.schedule.start(0, episode)
        self.parts.simulation.reset({0: replace(start, limit=self._limit)})

    @property
    def held(self) -> int:
        """How many vehicles agents drive."""
        return int(np.count_nonzero(self.world.vehicles.owner[0] == Owner.AGENT))

    def step(self) -> float:
        """Make a step; return its duration [s]."""
        actions = self.parts.actions
        actions.given[:] = True
        actions.values[:] = 0
        begin = time.perf_counter()
        frame = self.parts.simulation.step(actions, self._mask, self._nobody)
        taken = time.perf_counter() - begin
        if frame.failures:
            raise next(iter(frame.failures.values()))
        return taken

    def take(self, count: int) -> float:
        """Let agents take over vehicles in the next step; return what the announcements took [s]."""
        vehicles, begin = self.world.vehicles.of(0), time.perf_counter()
        free = np.flatnonzero(vehicles.owner == Owner.TRAFFIC)
        gates = self.parts.ownership.can_take(np.zeros(len(free), np.int32), free.astype(np.int32))
        free = free[gates == 0][:count]
        begin = time.perf_counter()
        self.parts.ownership.submit(transfers([self._transfer(slot) for slot in free.tolist()]))
        return time.perf_counter() - begin

    def _transfer(self, slot: int) -> Transfer:
        vehicles = self.world.vehicles.of(0)
        pose = (*vehicles.position[slot].tolist(), float(vehicles.heading[slot]))
        mission = self._missions.mission(0, slot)
        start = AgentStart("driver", pose, float(vehicles.speed[slot]), mission, interface=0)
        number, generation = self.parts.pool.announce(0, start), int(vehicles.generation[slot])
        return Transfer(0, slot, generation, Owner.TRAFFIC, UNSET, Owner.AGENT, UNSET, Reason.TAKE, number)


@contextmanager
def town(*arguments: object) -> Iterator[Town]:
    """Yield a `Town`, closed at the end."""
    made = Town(*arguments)  # type: ignore[arg-type]
    try:
        yield made
    finally:
        made.parts.simulation.close()


def time_take_overs(
    scenario: str, model: Model, agents: int, vehicles: int, seed: int
) -> tuple[float, float]:
    """Return the time of a take-over along a new route, and along a known one [s]."""
    with town(scenario, model, agents, vehicles, seed) as made:
        # The first pass compiles; the third is of the second's episode.
        _take_all(made, 1, agents)
        return _take_all(made, 0, agents), _take_all(made, 0, agents)


def _take_all(made: Town, episode: int, agents: int) -> float:
    """Let agents take over as many vehicles as they can; return the median time of one [s]."""
    made.begin(episode)
    taken = []
    for _ in range(4 * AFTER):
        made.step()
    while made.held + BATCH <= agents and len(taken) < 4 * agents // BATCH:
        before = made.held
        spent = made.take(BATCH) + made.step()
        count = made.held - before
        calm = statistics.median(made.step() for _ in range(AFTER))
        if count > 0:
            taken.append((spent - calm) / count)
    return statistics.median(taken)


def compare(
    scenario: str, model: Model, agents: int, vehicles: int, steps: int, seed: int
) -> tuple[float, float, float, float]:
    """Return the step without and with agents [s], how many agents, and of how many vehicles."""
    arguments = scenario, model, agents, vehicles, seed
    with town(*arguments) as plain, town(*arguments) as driven:
        times: list[tuple[float, float]] = []
        held, most = [], []
        for each in (plain, driven):
            each.begin(0)
        for step in range(3 * steps):
            if room := min(BATCH, agents - driven.held):
                driven.take(room)
            both = plain.step(), driven.step()
            if len(times) < steps and (driven.held >= 0.95 * agents or step > 2 * steps):
                times.append(both)
                held.append(driven.held)
                most.append(int(driven.world.vehicles.alive.sum()))
        without, with_agents = (statistics.median(column) for column in zip(*times, strict=True))
        return without, with_agents, statistics.mean(held), statistics.mean(most)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the times."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--scenario", default="city")
    parser.add_argument("--agents", type=int, default=100)
    parser.add_argument("--vehicles", type=int, default=300)
    parser.add_argument("--steps", type=int, default=150)
    parser.add_argument("--models", nargs="+", default=MODELS, choices=MODELS)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args(arguments)
    size = given.agents, given.vehicles
    print(f"{given.scenario}, at most {given.vehicles} vehicles; times in ms")
    for model in given.models:
        new, known = time_take_overs(given.scenario, model, *size, given.seed)
        print(f"{model}: a take-over {1e3 * new:.3f} along a new route, {1e3 * known:.3f} along a known one")
        without, driven, held, alive = compare(given.scenario, model, *size, given.steps, given.seed)
        each = (driven - without) / held
        print(
            f"{model}: {held:.0f} agents among {alive:.0f} vehicles: a step {1e3 * driven:.2f}, without"
            f" {1e3 * without:.2f}, {driven / without:.2f} times; a further agent {1e3 * each:.3f}"
        )


if __name__ == "__main__":
    main()
