"""Episodes that are over before the learning agents decide for the first time."""

import numpy as np
import pytest

from smarts.agents import AgentInterface, AgentType
from smarts.env import BlackDeath, SingleHiWayEnv, VectorHiWayEnv, hiway_parallel_env
from smarts.errors import ScenarioError, TrafficError
from smarts.providers.sumo_traffic import SumoTraffic
from tests.raising import raises
from tests.unit.sstudio.sources import scenario, write_cross

LATE = "ego_missions=[t.Mission(south_north, start_time=2.0)], traffic={'cars': t.Traffic(flows=[flow()])}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a scenario whose agent enters after 2 s."""
    folder = write_cross(tmp_path_factory.mktemp("late") / "late")
    (folder / "scenario.py").write_text(scenario(LATE))
    return folder


@pytest.fixture
def failing(monkeypatch):
    """Let SUMO fail in the first episode's second step."""
    step, steps = SumoTraffic.step, []

    def fail_once(self):
        steps.append(1)
        if len(steps) == 2:
            raise TrafficError("SUMO failed", place="late")
        step(self)

    monkeypatch.setattr(SumoTraffic, "step", fail_once)


def laner(**options):
    return AgentInterface.from_type(AgentType.Laner, **options)


@pytest.mark.usefixtures("failing")
def test_a_reset_says_that_traffic_has_failed_before_the_agent_was_there(folder, closing):
    env = closing(SingleHiWayEnv([folder], laner()))
    with raises(TrafficError, "late", values=["SUMO failed"]):
        env.reset(seed=1)
    env.reset()
    env.step(0)


@pytest.mark.usefixtures("failing")
def test_vectors_begin_again_instead(folder, closing):
    env = closing(VectorHiWayEnv(1, [folder], {"a": laner()}))
    step = env.reset(1)
    assert step.alive.all()
    assert not env.step([np.zeros((1, 1), int)]).reset.any()


def test_an_agent_that_ends_before_its_first_decision_is_named(folder, closing):
    env = closing(SingleHiWayEnv([folder], laner(max_episode_steps=2), decision_interval=15))
    with raises(ScenarioError, "episode 0", values=["'agent-0'", "time_out"]):
        env.reset(seed=1)


def test_a_fixed_list_of_agents_ends_with_all_of_them(tmp_path, closing):
    """Also with one that has come and gone between two decisions."""
    folder = write_cross(tmp_path / "both")
    missions = "[t.Mission(south_north), t.Mission(west_east, start_time=0.7)]"
    traffic = "{'none': t.Traffic(flows=[])}"
    (folder / "scenario.py").write_text(scenario(f"ego_missions={missions}, traffic={traffic}"))
    agents = {"a": laner(max_episode_steps=50), "b": laner(max_episode_steps=2)}
    env = closing(BlackDeath(hiway_parallel_env([folder], agents, observation=["speed"])))
    env.reset(seed=1)
    while env.agents:
        _, _, terminated, truncated, _ = env.step({})
    assert terminated == {"a": False, "b": False}
    assert truncated == {"a": True, "b": True}
