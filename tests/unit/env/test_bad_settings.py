"""What is refused before anything is built: names the value, the place and what to do."""

import numpy as np
import pytest

from smarts.agents import AgentInterface
from smarts.agents.benchmark import benchmark_interface
from smarts.env import HiWayEnv, RLlibHiWayEnv, VectorHiWayEnv
from smarts.env.settings import EnvSettings
from smarts.errors import SmartsError
from smarts.rewards.weights import RewardWeights, given_weights
from smarts.sim.assembly import Options
from smarts.types.streams import check_seed

LANER = benchmark_interface()


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"scenarios": "loop"}, r"give a list: scenarios=\['loop'\]"),
        ({"scenarios": None}, "scenarios is None"),
        ({"scenarios": [42]}, "42 is not a scenario"),
        ({"traffic": "light"}, r"give a list: traffic=\['light'\]"),
        ({"traffic": []}, r"traffic is \[\]"),
        ({"agents": 2.0}, "the agents are 2.0"),
        ({"agents": True}, "the agents are True"),
        ({"agents": 0}, "agents is 0"),
        ({"agents": ["a"]}, r"the agents are \['a'\]"),
        ({"agents": {"__all__": LANER}}, "an agent is called '__all__'"),
        ({"agents": {"": LANER}}, "an agent is called ''"),
        ({"agents": {5: LANER}}, "an agent is called 5"),
        ({"decision_interval": 2.5}, "decision_interval is 2.5"),
        ({"decision_interval": "5"}, "decision_interval is '5'"),
        ({"decision_interval": 0}, "decision_interval is 0"),
        ({"decision_interval": 101}, "whole number from 1 to 100"),
        ({"num_envs": 0}, "num_envs is 0"),
        ({"num_envs": 1.5}, "num_envs is 1.5"),
        ({"simulation": {"dt": 0.1}}, "simulation is {'dt': 0.1}"),
        ({"adapter": "benchmrk"}, "did you mean 'benchmark'"),
        ({"adapter": int}, "the adapter is <class 'int'>"),
        ({"adapter_options": {"rewrd": 1}}, "no option 'rewrd'.*\n.*did you mean 'reward'"),
        ({"adapter_options": 4}, "adapter_options is 4"),
    ],
)
def test_settings(bad, message):
    with pytest.raises(SmartsError, match=message):
        EnvSettings(**{"scenarios": ["loop"], **bad})


@pytest.mark.parametrize("seed", ["x", 1.5, None, -1, 2**63, True])
def test_seeds_that_are_none(seed):
    with pytest.raises(SmartsError, match="is not a seed"):
        EnvSettings(["loop"], seed=seed)
    with pytest.raises(SmartsError, match="is not a seed"):
        check_seed(seed, "here")


@pytest.mark.parametrize("seed", [0, 2**63 - 1, np.int64(3)])
def test_seeds(seed):
    assert EnvSettings(["loop"], seed=seed).seed == seed
    check_seed(seed, "here")


@pytest.mark.parametrize("path", [0, -1, 2.5, True])
def test_paths_have_points(path):
    with pytest.raises(SmartsError, match="number of points"):
        Options(path=path)


def test_rllib_configurations():
    with pytest.raises(SmartsError, match="agents and agent_specs are both there"):
        RLlibHiWayEnv({"scenarios": ["loop"], "agents": 2, "agent_specs": 3})
    with pytest.raises(SmartsError, match="there are no scenarios"):
        RLlibHiWayEnv({})


def test_an_interface_is_enough_and_seeds_of_resets_are_checked():
    env = HiWayEnv(["loop"], {"a": AgentInterface(max_episode_steps=2)})
    try:
        for seed in (-1, 1.5):
            with pytest.raises(SmartsError, match="is not a seed"):
                env.reset(seed=seed)
        observations, _ = env.reset(seed=3)
        assert [*observations] == ["a"]
    finally:
        env.close()


def test_numbers_of_a_vector_reset():
    env = VectorHiWayEnv(2, ["loop"], 1)
    try:
        for bad in (
            {"worlds": [1]},
            {"worlds": [0.5, 1.0]},
            {"worlds": [-1, 0]},
            {"episode": 2**40},
            {"episode": -1},
            {"stride": 1.5},
            {"seed": -1},
        ):
            with pytest.raises(SmartsError):
                env.reset(**bad)
        env.reset(worlds=[5, 3], episode=7)
        assert [(start.world, start.episode) for start in env.episodes] == [(5, 7), (3, 7)]
    finally:
        env.close()


def test_rewards_may_be_dicts():
    assert given_weights({"goal": 1}) == RewardWeights(goal=1)
    for bad, message in (
        ({"gaol": 1}, "did you mean 'goal'"),
        ({"goal": "1"}, "not a number"),
        (4, "not a rew"),
    ):
        with pytest.raises(SmartsError, match=message):
            given_weights(bad)
