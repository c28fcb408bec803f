"""RLlib bootstraps the last observation of truncated agents only."""

import pytest
from ray.rllib.env.multi_agent_episode import MultiAgentEpisode

from smarts.agents import AgentInterface, AgentSpec
from smarts.agents.benchmark import benchmark_interface
from smarts.env import HiWayEnv, RLlibHiWayEnv
from smarts.env.dict_env import StepResult
from smarts.env.rllib import _dones


def played(limits, drive=0):
    """Return RLlib's episode of agents with these time limits [steps], and the env's last dicts."""
    agents = {name: benchmark_interface(max_episode_steps=steps) for name, steps in limits.items()}
    env = RLlibHiWayEnv({"scenarios": ["intersection"], "agents": agents, "seed": 1})
    try:
        observations, infos = env.reset()
        episode = MultiAgentEpisode()
        episode.add_env_reset(observations=observations, infos=infos)
        ends, cuts = {}, {}
        while not (ends.get("__all__") or cuts.get("__all__")):
            actions = {name: drive for name in env.agents if not (ends.get(name) or cuts.get(name))}
            observations, rewards, ends, cuts, infos = env.step(actions)
            episode.add_env_step(observations, actions, rewards, infos, terminateds=ends, truncateds=cuts)
        return episode, ends, cuts, infos
    finally:
        env.close()


@pytest.mark.parametrize("limits", [{"a": 10, "b": 20}, {"a": 10, "b": 10}])
def test_who_runs_out_of_time_is_truncated_and_not_terminated(limits):
    episode, ends, cuts, infos = played(limits)
    assert not ends["__all__"]
    assert cuts["__all__"]
    assert episode.is_done
    for name, steps in limits.items():
        its = episode.agent_episodes[name]
        assert (its.is_terminated, its.is_truncated, len(its)) == (False, True, steps // 5)
    assert {info["outcome"] for info in infos.values()} == {"time_out"}


def test_who_ends_in_the_scenario_is_terminated():
    episode, ends, cuts, infos = played({"a": 1000})
    assert infos["a"]["outcome"] != "time_out"
    assert ends == {"a": True, "__all__": True}
    assert cuts == {"a": False, "__all__": False}
    its = episode.agent_episodes["a"]
    assert (its.is_terminated, its.is_truncated) == (True, False)


def test_the_paper_face_says_that_time_was_up():
    env = HiWayEnv(["loop"], {"a": AgentSpec(interface=AgentInterface(max_episode_steps=2))})
    try:
        env.reset(seed=1)
        assert [env.step({})[3]["__all__"] for _ in range(2)] == [False, True]
    finally:
        env.close()


def test_where_some_of_the_last_agents_are_cut_short_the_episode_is_truncated():
    ended, cut = {"a": True, "b": False}, {"a": False, "b": True}
    result = StepResult({}, {}, ended, cut, {}, [], finished=True)
    assert _dones(result) == ({**ended, "__all__": False}, {"a": False, "b": False, "__all__": True})
