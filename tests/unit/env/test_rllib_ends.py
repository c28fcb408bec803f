"""RLlib bootstraps the last observation of truncated agents only."""

from contextlib import closing

import pytest
from ray.rllib.env.multi_agent_episode import MultiAgentEpisode

from smarts.agents.benchmark import benchmark_interface
from smarts.env import RLlibHiWayEnv


def played(limits, drive=0):
    """Return RLlib's episode of agents with these time limits [steps], and the env's last dicts."""
    agents = {name: benchmark_interface(max_episode_steps=steps) for name, steps in limits.items()}
    with closing(RLlibHiWayEnv({"scenarios": ["intersection"], "agents": agents, "seed": 1})) as env:
        observations, infos = env.reset()
        episode = MultiAgentEpisode()
        episode.add_env_reset(observations=observations, infos=infos)
        ends, cuts = {}, {}
        while not (ends.get("__all__") or cuts.get("__all__")):
            actions = {name: drive for name in env.agents if not (ends.get(name) or cuts.get(name))}
            observations, rewards, ends, cuts, infos = env.step(actions)
            episode.add_env_step(observations, actions, rewards, infos, terminateds=ends, truncateds=cuts)
        return episode, ends, cuts, infos


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
