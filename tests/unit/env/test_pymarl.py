"""EPyMARL's environment: the PettingZoo environment's episodes, as lists of all agents."""

import numpy as np
import pytest

from smarts.agents import AgentInterface
from smarts.env import PyMARLEnv, hiway_parallel_env
from smarts.types.actions import ActionSpaceType

SHARED = {"scenarios": ["intersection"], "agents": 3, "seed": 5, "traffic": ["no_social_vehicles"]}


@pytest.fixture(scope="module")
def envs():
    pair = PyMARLEnv(**SHARED), hiway_parallel_env(**SHARED)
    yield pair
    for env in pair:
        env.close()


def episode(env, choose):
    """Play an episode; yield what a step returns, and the actions."""
    over = False
    while not over:
        actions = [choose(allowed) for allowed in env.get_avail_actions()]
        result = env.step(actions)
        over = result[2] or result[3]
        yield actions, result


def test_an_episode_is_that_of_the_pettingzoo_environment(envs):
    lists, parallel = envs
    first, _ = lists.reset(seed=11)
    observations, infos = parallel.reset(seed=11)
    for given, name in zip(first, parallel.possible_agents, strict=True):
        np.testing.assert_array_equal(given, observations[name])
    random, outcomes, info = np.random.default_rng(3), [], {}
    for actions, (seen, reward, ended, cut, info) in episode(
        lists, lambda allowed: random.choice(np.flatnonzero(allowed))
    ):
        acted = dict(zip(parallel.possible_agents, actions, strict=True))
        result = parallel.step({name: acted[name] for name in parallel.agents})
        observations, rewards, _, truncated, infos = result
        assert reward == sum(rewards.values())
        for row, name in enumerate(parallel.possible_agents):
            present = name in parallel.agents
            np.testing.assert_array_equal(seen[row], observations.get(name, np.zeros(first[0].shape)))
            mask = infos[name]["action_mask"] if present else [1, 0, 0, 0]
            assert lists.get_avail_agent_actions(row) == [*mask]
            assert lists.get_state()[-lists.n_agents + row] == present
        np.testing.assert_array_equal(lists.get_state()[:-3], np.concatenate(seen))
        assert (ended or cut) == (not parallel.agents)
        assert cut == info.get("episode_limit", False) == (not parallel.agents and any(truncated.values()))
        outcomes += [info["outcome"] for info in infos.values() if "outcome" in info]
        assert info["completed"] == outcomes.count("goal") / 3
        assert info["collided"] == outcomes.count("collision") / 3
    assert len(outcomes) == 3


def test_agents_that_stand_are_cut_at_the_limit():
    interface = AgentInterface(action=ActionSpaceType.Lane, max_episode_steps=23)
    with_limit = {name: interface for name in ("a", "b")}
    env = PyMARLEnv(["intersection"], with_limit, common_reward=False, decision_interval=5)
    assert env.episode_limit == 5  # decisions of 5 steps; the last one is cut after 3
    env.reset()
    results = [result for _, result in episode(env, lambda allowed: 0)]
    assert len(results) == 5
    assert results[-1][2:4] == (False, True)
    assert results[-1][4]["episode_limit"] is True
    assert np.shape(results[-1][1]) == (2,)
    env.reset()
    env.step([0, 0])
    env.close()
