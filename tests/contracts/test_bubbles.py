"""Bubbles in SUMO's traffic: they change nothing where they take no vehicle, and runs repeat bit for bit."""

import hashlib
import shutil

import numpy as np
import pytest

from smarts.env.vector import VectorHiWayEnv
from smarts.sstudio.build import build_scenario
from smarts.types.actions import LaneAction
from smarts.types.agent_states import AgentStatus
from smarts.types.vehicles import Owner

DECISIONS, PERIOD, SEED = 80, 5, 11
SCENARIO = """
from pathlib import Path
from smarts.sstudio import gen_scenario, types as t

kinds = {"passenger": 4, "bus": 1, "truck": 1, "trailer": 1}
actors = {t.TrafficActor(kind, vehicle_type=kind): share for kind, share in kinds.items()}
ways = ("south", "west", "north", "east")
routes = [t.Route((f"{a}_in", 0, "base"), (f"{b}_out", 0, "max")) for a in ways for b in ways if a != b]
idm = t.SocialAgentActor("idm", "smarts.zoo:idm-v0")
laner = t.SocialAgentActor("laner", "smarts.zoo:keep-lane-v0")
middle, south = t.PositionalZone((0, 0), (90, 90)), t.MapZone(("south_in", 0, 40), 60, 2)
gen_scenario(
    t.Scenario(
        traffic={"mixed": t.Traffic([t.Flow(route, 200, actors=actors) for route in routes], warm_up=20)},
        ego_missions=[t.Mission(t.Route(("south_in", 1, 40), ("west_out", 0, 60)))],
        bubbles=[BUBBLES],
    ),
    output_dir=Path(__file__).parent,
)
"""
NONE_TAKEN = """
    t.Bubble(middle, idm, airlock_condition=t.VehicleSpeedCondition(900, 901)),
    t.Bubble(middle, laner, active_condition=t.TimeWindowCondition(1e6, 2e6)),
    t.Bubble(middle, laner, follow_vehicle_id="nobody", follow_offset=(0, 10)),
    t.Bubble(south, idm, active_condition=t.DependeeActorCondition("nobody")),
"""
ALL_KINDS = """
    t.Bubble(south, laner, margin=5, limit=t.BubbleLimits(2, 4), collision_time=2),
    t.Bubble(middle, idm, margin=10, exclusion_prefixes=["truck"],
             active_condition=t.TimeWindowCondition(1, 25), airlock_condition=-t.VehicleTypeCondition("bus")),
    t.Bubble(middle, t.TrafficEngineActor("local"), margin=10),
    t.Bubble(t.PositionalZone((0, 0), (40, 20)), laner, follow_actor_id="agent-0", follow_offset=(0, 15)),
"""


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    def written(name, bubbles):
        folder = tmp_path_factory.mktemp("bubbles") / name
        folder.mkdir()
        for source in build_scenario("intersection").source.glob("map.*.xml"):
            shutil.copy(source, folder)
        (folder / "scenario.py").write_text(SCENARIO.replace("BUBBLES", bubbles))
        return folder

    return written


class Run:
    """Simulations of some worlds of a scenario, whose ego keeps its lane."""

    def __init__(self, folder, worlds=(0,)):
        self.env = VectorHiWayEnv(len(worlds), [folder], 1, decision_interval=PERIOD)
        self.env.reset(SEED, np.array(worlds))
        self.actions = [np.full((len(worlds), 1), LaneAction.keep_lane)]

    @property
    def world(self):
        return self.env._runner.world

    def played(self):
        """Yield the world after each decision."""
        try:
            for _ in range(DECISIONS):
                self.env.step(self.actions)
                yield self.world
        finally:
            self.env.close()


def hashes(folder, worlds):
    run, made = Run(folder, worlds), [hashlib.blake2b() for _ in worlds]
    for world in run.played():
        for row, hashed in enumerate(made):
            for column in (*world.vehicles, *world.agents):
                hashed.update(column[row].tobytes())
    return [hashed.hexdigest() for hashed in made]


def test_bubbles_that_take_no_vehicle_change_no_bit(scenario):
    without, with_bubbles = Run(scenario("without", "")), Run(scenario("unused", NONE_TAKEN))
    capacity, moved = without.world.vehicles.capacity, 0.0
    assert with_bubbles.world.vehicles.capacity > capacity, "there are columns for the bubbles' agents"
    for one, other in zip(without.played(), with_bubbles.played(), strict=True):
        for name, column in one.vehicles._asdict().items():
            assert np.array_equal(column, getattr(other.vehicles, name)[:, :capacity]), name
        assert not other.vehicles.alive[:, capacity:].any()
        moved += float(one.vehicles.speed.sum())
    assert moved > 100


def test_vehicles_are_taken_and_go_back(scenario):
    run, taken, went_back, was_taken = Run(scenario("taken", ALL_KINDS)), set(), set(), {}
    for world in run.played():
        vehicles = world.vehicles.of(0)
        for slot in np.flatnonzero(vehicles.alive).tolist():
            vehicle = slot, int(vehicles.generation[slot])
            if vehicles.home[slot] == Owner.TRAFFIC and vehicles.owner[slot] == Owner.AGENT:
                taken.add(vehicle)
            elif vehicle in taken:
                went_back.add(vehicle)
        agents = world.agents
        held = agents.slot[0][agents.slot[0] >= 0].tolist()
        assert len(held) == len(set(held)), "no vehicle has two agents"
        was_taken |= dict.fromkeys(agents.state[0].tolist())
    assert len(taken) > 10
    assert len(went_back) > 5
    assert {AgentStatus.SHADOWING, AgentStatus.ACTIVE} <= set(was_taken)


def test_a_row_of_a_batch_equals_the_run_alone_and_runs_repeat(scenario):
    folder = scenario("repeated", ALL_KINDS)
    together = hashes(folder, (2, 0, 1))
    assert len(set(together)) == 3
    assert [*hashes(folder, (0,)), *hashes(folder, (1,))] == together[1:]
    assert hashes(folder, (2,)) == together[:1]
