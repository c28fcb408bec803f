"""The step: what happens in one simulation is the same whatever happens beside it."""

import hashlib

import numpy as np
import pytest

from smarts.sstudio.build import build_scenario
from smarts.types.agent_states import AgentStatus
from smarts.types.vehicles import Owner
from tests.parts import episode, simulation_of

EGOS = 2


@pytest.fixture(scope="module")
def scenarios():
    return [build_scenario("intersection"), build_scenario("double_merge")]


class Run:
    """A simulation whose egos are driven in a way that depends on the world, agent and step only."""

    def __init__(self, scenarios, starts):
        self.simulation, self.actions = simulation_of(scenarios, worlds=len(starts), egos=EGOS)
        self.starts = starts
        self.world = self.simulation.world
        self.hashes = [hashlib.blake2b() for _ in starts]
        self.reset(range(len(starts)))

    def reset(self, rows):
        self.simulation.reset({row: self.starts[row] for row in rows})
        for row in rows:
            self._hash(row)

    def step(self, rows):
        mask = np.zeros(self.world.worlds, np.bool_)
        mask[list(rows)] = True
        for row in rows:
            for agent_id in range(EGOS):
                phase = self.world.step[row] / 20 + agent_id + self.starts[row].world
                self.actions.values[row, agent_id, :3] = 0.4, 0.0, 0.05 * np.sin(phase)
        self.simulation.step(self.actions, mask, mask[:, None] & np.ones(EGOS, np.bool_))
        for row in rows:
            self._hash(row)

    def state(self, row):
        world = self.world
        tables = (world.vehicles, world.before, world.agents)
        return b"".join(column[row].tobytes() for table in tables for column in table)

    def _hash(self, row):
        self.hashes[row].update(self.state(row) + self.world.signals[row].tobytes())

    def close(self):
        self.simulation.close()


@pytest.fixture
def new_run(scenarios):
    runs = []

    def make(*worlds):
        starts = [episode(scenarios, world % 2, egos=EGOS, world=world) for world in worlds]
        runs.append(Run(scenarios, starts))
        return runs[-1]

    yield make
    for run in runs:
        run.close()


def test_two_together_equal_two_alone(new_run):
    together = new_run(0, 1)
    alone = [new_run(0), new_run(1)]
    for _ in range(200):
        together.step([0, 1])
        for run in alone:
            run.step([0])
    lanes = [len(graph.signals[0]) for graph in (together.world, alone[0].world)]
    assert lanes[0] == lanes[1]
    assert [h.hexdigest() for h in together.hashes] == [run.hashes[0].hexdigest() for run in alone]
    assert together.world.vehicles.alive.sum(axis=1).min() > EGOS + 3


def test_a_pause_or_a_reset_beside_changes_nothing(new_run):
    together, alone = new_run(0, 1), new_run(0)
    for step in range(100):
        if step == 60:
            together.reset([1])
        together.step([0] if 20 <= step < 40 else [0, 1])
        alone.step([0])
    assert together.hashes[0].hexdigest() == alone.hashes[0].hexdigest()


def test_a_paused_simulation_stays_as_it_is(new_run):
    run = new_run(0, 1)
    run.step([0, 1])
    before = run.state(1)
    for _ in range(5):
        run.step([0])
    assert run.state(1) == before
    assert run.world.step.tolist() == [6, 1]


def test_the_same_episode_again_is_the_same(new_run):
    run = new_run(0)
    first = [run.state(0)]
    for _ in range(50):
        run.step([0])
        first.append(run.state(0))
    run.reset([0])
    second = [run.state(0)]
    for _ in range(50):
        run.step([0])
        second.append(run.state(0))
    assert first == second


def test_after_a_reset_egos_sit_in_the_first_slots(new_run):
    run = new_run(0, 1)
    world = run.world
    assert world.agents.slot.tolist() == [[0, 1], [0, 1]]
    assert (world.agents.state == AgentStatus.ACTIVE).all()
    assert (world.vehicles.owner[:, :EGOS] == Owner.AGENT).all()
    assert world.agents.on_route.all()
    assert (world.agents.remaining > 20).all()
    for now, before in zip(world.vehicles, world.before, strict=True):
        assert (now == before).all()


def test_everybody_is_located_and_traffic_has_routes(new_run):
    run = new_run(0)
    for _ in range(100):
        run.step([0])
    vehicles = run.world.vehicles
    alive = vehicles.alive[0]
    assert (vehicles.lane[0, alive] >= 0).all()
    assert (vehicles.lane[0, ~alive] == -1).all()
    assert (np.abs(vehicles.lane_offset[0, alive & (vehicles.owner[0] == Owner.TRAFFIC)]) < 2.5).all()
    assert (vehicles.route[0, alive] >= 0).all()
