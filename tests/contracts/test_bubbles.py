"""Bubbles in SUMO's traffic: unused ones change nothing; runs and records repeat bit for bit."""

import hashlib
import shutil
from contextlib import closing

import numpy as np
import pytest

from smarts.env.vector import VectorHiWayEnv
from smarts.registry import import_own
from smarts.sim.assembly import Options
from smarts.sim.episode_files import RecordedEpisode
from smarts.sstudio.build import build_scenario
from smarts.types.actions import LaneAction
from smarts.types.episode_schema import AGENT_FAILURES, BUBBLE_POSES, BUBBLE_RINGS, BUBBLES, HOLDS, TRANSFERS
from smarts.types.transfers import Reason

DECISIONS, PERIOD, SEED = 80, 5, 11
HANDOVERS = (HOLDS, TRANSFERS, BUBBLES, BUBBLE_RINGS, BUBBLE_POSES, AGENT_FAILURES)
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
WITH_MEMORIES = """
    t.Bubble(t.PositionalZone((0, 25), (90, 50)), t.BoidAgentActor("flock", "counting:counting-v0"),
             margin=10, keep_alive=True),
    t.Bubble(t.PositionalZone((0, -25), (90, 50)), t.BoidAgentActor("boids", "smarts.zoo:boids-v0"),
             margin=10, keep_alive=True),
    t.Bubble(t.MapZone(("west_in", 0, 10), 60, 2), t.SocialAgentActor("random", "smarts.zoo:random-v0")),
    t.Bubble(t.MapZone(("east_in", 0, 10), 60, 2), t.SocialAgentActor("alone", "counting:counting-v0")),
"""
COUNTING = """
from smarts.agents import Agent, AgentInterface
from smarts.types.actions import ActionSpaceType
from smarts.zoo import register


class Counting(Agent):
    interface = AgentInterface(action=ActionSpaceType.LaneWithContinuousSpeed, vehicle_model="kinematic")

    def __init__(self):
        self._asked = 0

    def act(self, obs):
        self._asked += 1
        action = 3.0 + self._asked % 7, 0
        return dict.fromkeys(obs, action) if isinstance(obs, dict) else action


register("counting-v0", Counting)
"""


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    module = tmp_path_factory.mktemp("agents") / "counting.py"
    module.write_text(COUNTING)
    import_own([module])

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

    def __init__(self, folder, worlds=(0,), **options):
        self.env = VectorHiWayEnv(len(worlds), [folder], 1, decision_interval=PERIOD, **options)
        self.worlds = np.array(worlds)
        self.env.reset(SEED, self.worlds)
        self.actions = [np.full((len(worlds), 1), LaneAction.keep_lane)]

    @property
    def world(self):
        return self.env._runner.world

    def played(self):
        """Yield the world after each decision."""
        with closing(self.env):
            yield from self.decisions()

    def decisions(self):
        for _ in range(DECISIONS):
            self.env.step(self.actions)
            yield self.world


def hashes(folder, worlds, before=0, record=None):
    """Return a hash of each row's run, after `before` decisions and another reset of the same seed."""
    run = Run(folder, worlds, simulation=Options(record=record))
    made = [hashlib.blake2b() for _ in worlds]
    if before:
        for _ in range(before):
            run.env.step(run.actions)
        run.env.reset(SEED, run.worlds)
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


def handovers(folder):
    """Return what is recorded of the hand-overs in the first episode of world 0, by table and column."""
    episode = RecordedEpisode(folder / f"seed{SEED}_world0_episode00000")
    return {table.name: episode.table(table.name) for table in HANDOVERS}


def test_agents_with_memories_repeat_alone_in_a_batch_and_after_another_reset(scenario, tmp_path):
    """And so do the records of their hand-overs."""
    folder = scenario("memories", ALL_KINDS + WITH_MEMORIES)
    together = hashes(folder, (2, 0, 1), record=tmp_path / "batch")
    assert len(set(together)) == 3
    alone = hashes(folder, (0,), record=tmp_path / "alone")
    assert [*alone, *hashes(folder, (1,), before=11)] == together[1:]
    one, other = handovers(tmp_path / "batch"), handovers(tmp_path / "alone")
    for name, columns in one.items():
        for column, values in columns.items():
            assert [*map(_plain, values)] == [*map(_plain, other[name][column])], (name, column)
    assert len(one["holds"]["name"]) > 10
    assert {Reason.SHADOW, Reason.TAKE, Reason.RELEASE} <= set(one["transfers"]["reason"].tolist())
    assert one["bubbles"]["taken"].sum() > 5
    assert len(one["bubble_poses"]["step"]) > len(one["bubbles"]["id"]), "one travels"


def _plain(value):
    return value.tolist() if isinstance(value, np.ndarray) else value
