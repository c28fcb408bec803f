"""Social agents of scenarios and environments: who is cast, where they start, what is refused."""

import shutil
from contextlib import closing

import numpy as np
import pytest

from smarts.agents.benchmark import benchmark_interface
from smarts.agents.options import InterfaceError
from smarts.agents.social import SocialAgents
from smarts.env import HiWayEnv, VectorHiWayEnv
from smarts.env.casting import cast_of
from smarts.errors import SmartsError
from smarts.sim.schedule import Schedule
from smarts.sstudio.build import build_scenario
from smarts.types.agent_states import AgentStatus, agent_names
from tests.raising import raises

KEEP_LANE, IDM = "smarts.zoo:keep-lane-v0", "smarts.zoo:idm-v0"
SCENARIO = """
from pathlib import Path
from smarts.sstudio import gen_scenario, types as t

def way(begin, end, time=0.0):
    return t.Mission(t.Route(begin=begin, end=end), start_time=time)

actor = t.SocialAgentActor
gen_scenario(
    t.Scenario(
        ego_missions=[way(("south_in", 1, 40), ("west_out", 0, 60))],
        social_agent_missions={
            "pair": (
                [
                    actor("first", "LOCATOR", initial_speed=5.0),
                    actor("second", "smarts.zoo:keep-lane-v0"),
                ],
                [
                    way(("west_in", 1, 50), ("east_out", 0, 60)),
                    way(("west_in", 1, 50), ("east_out", 0, 60), 3.0),
                ],
            ),
            "turns": (
                [actor("third", "LOCATOR")],
                [
                    t.Mission(
                        t.Route(begin=("north_in", 0, 40), end=("south_out", 1, 40)),
                        via=(t.Via("north_in", 0, 48, 5.0), t.Via("north_in", 0, 52, 5.0)),
                    ),
                    way(("east_in", 0, 50), ("west_out", 1, 40)),
                    way(("south_in", 1, 41), ("north_out", 1, 40)),
                ],
            ),
        },
    ),
    output_dir=Path(__file__).parent,
)
"""


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    return written(tmp_path_factory.mktemp("social") / "meeting")


def written(folder, locator=IDM):
    """Write the scenario; return its folder."""
    folder.mkdir()
    for source in build_scenario("intersection").source.glob("map.*.xml"):
        shutil.copy(source, folder)
    (folder / "scenario.py").write_text(SCENARIO.replace("LOCATOR", locator))
    return folder


def schedule_of(scenarios, egos, added=(), learning=None):
    built = [build_scenario(scenario) for scenario in scenarios]
    return Schedule(built, agent_names(egos), cast=cast_of(built, added, learning))


def test_groups_enter_at_once_or_take_turns(scenario):
    schedule = schedule_of([scenario], 1)
    starts = [schedule.start(0, episode) for episode in range(3)]
    for start in starts:
        assert [agent.name for agent in start.agents] == [
            "agent-0",
            "social-agent-pair-first",
            "social-agent-pair-second",
            "social-agent-turns-third",
        ]
        assert [agent.policy for agent in start.agents] == [-1, 0, 1, 0]
        assert [agent.entry_time for agent in start.agents[1:3]] == [0.0, 3.0]
        assert [agent.speed for agent in start.agents[1:]] == [5.0, 0.0, 0.0]
        assert start.room is not None
        assert sum(start.room) == 3
    begun = {start.agents[3].pose for start in starts}
    assert len(begun) == 3, "each mission of the third in turn"
    blocked = [start.agents[3] for start in starts if start.agents[3].entry_time > 0]
    assert len(blocked) == 1, "the ego is in the way of one: it enters when it is free"
    assert schedule.vias == 2


def test_social_agents_of_a_scenario_drive_in_every_environment(scenario):
    with closing(VectorHiWayEnv(2, [scenario], agents=1)) as env:
        env.reset(3)
        for _ in range(10):
            step = env.step([np.zeros((2, 1), int)])
            assert not step.social_failures
        agents = env._runner.world.agents
        assert ((agents.state[:, 1:] == AgentStatus.ACTIVE).sum(axis=1) >= 2).all()
        assert agents.distance_travelled[:, 1:].max() > 10
    with closing(HiWayEnv([scenario], {"me": benchmark_interface()})) as env:
        observations, _ = env.reset(seed=1)
        assert [*observations] == ["me"]
        infos = env.step({"me": "keep_lane"})[4]
        assert "social_failures" not in infos["me"]


def test_a_social_agent_whose_start_is_occupied_is_named_until_it_enters(scenario, closing):
    env, third = closing(HiWayEnv([scenario], {"me": benchmark_interface()})), "social-agent-turns-third"
    kept = []
    for _ in range(3):  # The mission of one of the turns begins a metre ahead of the ego.
        env.reset()
        for _ in range(3):
            *_, infos = env.step({"me": "slow_down"})
        kept.append(infos["me"].get("kept_out"))
        if kept[-1]:
            break
    assert kept[-1] == [third]
    assert not any(kept[:-1])
    for _ in range(150):
        *_, infos = env.step({"me": "keep_lane"})
        if "kept_out" not in infos["me"]:
            return
    pytest.fail("the agent does not enter, though the ego has gone")


def test_agents_of_the_zoo_take_the_missions_that_the_egos_leave():
    added = [SocialAgents(KEEP_LANE), SocialAgents(IDM, "missions", {"tau": 1.5})]
    schedule = schedule_of(["intersection"], 1, added)
    routes, every = set(), set()
    for episode in range(len(schedule.combinations)):
        start = schedule.start(0, episode)
        assert [agent.policy for agent in start.agents] == [-1, 0, 1, 1]
        ways = [(agent.mission.route[0], agent.mission.route[-1]) for agent in start.agents]
        assert len(set(ways)) == 4, "each mission once"
        routes.add(ways[0])
        every |= set(ways)
    assert routes == every, "the ego takes turns with all missions"


def test_more_agents_than_missions():
    with raises(InterfaceError, "social_agents in intersection", values=["3 missions"]):
        schedule_of(["intersection"], 1, [SocialAgents(KEEP_LANE, 4)])


@pytest.mark.parametrize(
    "added",
    [
        {"agent": "smarts.zoo:nobody-v0"},
        {"agent": KEEP_LANE, "options": {"colour": "red"}},
        {"agent": KEEP_LANE, "number": 2},
    ],
)
def test_what_is_no_social_agent(added):
    with pytest.raises(SmartsError) as error:
        VectorHiWayEnv(1, ["intersection"], agents=1, social_agents=[added])
    assert "social_agents" in error.value.place


def test_an_unknown_locator_in_a_scenario_names_its_actor(tmp_path):
    folder = written(tmp_path / "strange", "smarts.zoo:nobody-v0")
    with pytest.raises(SmartsError) as error:
        VectorHiWayEnv(1, [folder], agents=1)
    assert "'pair'" in error.value.place
    assert "'first'" in error.value.place
    assert "nobody-v0" in error.value.problem
