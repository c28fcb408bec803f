"""What is refused before anything is built: names the value, the place and what to do."""

import numpy as np
import pytest

from smarts.agents import AgentInterface, AgentSpec
from smarts.agents.benchmark import benchmark_interface
from smarts.agents.options import InterfaceError
from smarts.env import HiWayEnv, RLlibHiWayEnv, SingleHiWayEnv, VectorHiWayEnv, hiway_parallel_env
from smarts.env.settings import EnvSettings
from smarts.errors import OwnCodeError, ScenarioError, SmartsError, UnknownNameError
from smarts.rewards.weights import RewardWeights, given_weights
from smarts.sim.assembly import Options
from smarts.types.streams import check_seed
from tests.raising import raises

LANER = benchmark_interface()


@pytest.mark.parametrize(
    ("bad", "place", "value"),
    [
        ({"scenarios": "loop"}, "scenarios", ["loop"]),
        ({"scenarios": None}, "scenarios", None),
        ({"scenarios": [42]}, "scenarios", 42),
        ({"traffic": "light"}, "traffic", ["light"]),
        ({"traffic": []}, "traffic", []),
        ({"agents": 2.0}, "agents", 2.0),
        ({"agents": True}, "agents", True),
        ({"agents": 0}, "agents", 0),
        ({"agents": ["a"]}, "agents", ["a"]),
        ({"agents": {"__all__": LANER}}, "agents", "__all__"),
        ({"agents": {"": LANER}}, "agents", "''"),
        ({"agents": {5: LANER}}, "agents", 5),
        ({"decision_interval": 2.5}, "decision_interval", 2.5),
        ({"decision_interval": "5"}, "decision_interval", "'5'"),
        ({"decision_interval": 0}, "decision_interval", 0),
        ({"decision_interval": 101}, "decision_interval", 101),
        ({"num_envs": 0}, "num_envs", 0),
        ({"num_envs": 1.5}, "num_envs", 1.5),
        ({"simulation": {"dt": 0.1}}, "simulation", {"dt": 0.1}),
        ({"envision": 8081}, "envision", 8081),
        ({"envision": "localhost"}, "envision", "localhost"),
    ],
)
def test_settings(bad, place, value):
    with raises(SmartsError, place, values=[value]):
        EnvSettings(**{"scenarios": ["loop"], **bad})


def own_adapter(context, observation, reward, discount, *, factor=1.0): ...


@pytest.mark.parametrize(
    ("bad", "kind", "place", "value"),
    [
        ({"observation": "benchmrk"}, SmartsError, "observation", "benchmrk"),
        ({"observation": 4}, SmartsError, "observation", "4"),
        ({"observation": ["gaol"]}, UnknownNameError, "", "gaol"),
        ({"reward": {"gaol": 1}}, ScenarioError, "reward", "gaol"),
        ({"reward": "papr"}, ScenarioError, "rewards.yaml", "papr"),
        ({"reward": "no_such_module:A"}, OwnCodeError, "", "no_such_module"),
        ({"adapter": "paper"}, InterfaceError, "adapter", "paper"),
        ({"adapter": 3}, InterfaceError, "adapter", "3"),
        ({"adapter": int}, InterfaceError, "adapter", "int"),
        ({"adapter": own_adapter, "adapter_options": {"fctor": 1}}, InterfaceError, "adapter", "fctor"),
        ({"adapter": own_adapter, "adapter_options": 4}, InterfaceError, "adapter_options", "4"),
        ({"adapter_options": {"reward": "paper"}}, InterfaceError, "adapter_options", "paper"),
    ],
)
def test_observations_rewards_and_adapters_that_are_none(bad, kind, place, value):
    with raises(kind, place, values=[value]):
        EnvSettings(["loop"], **bad)


def test_old_keywords_name_the_new_ones():
    for old, new in (
        ({"adapter": "paper"}, "observation='paper'"),
        ({"adapter_options": {"a": 1}}, "reward="),
    ):
        with pytest.raises(InterfaceError) as raised:
            EnvSettings(["loop"], **old)
        assert new in raised.value.remedy


def test_an_own_adapter_gets_its_options():
    settings = EnvSettings(["loop"], adapter=own_adapter, adapter_options={"factor": 2.0})
    assert settings.adapter_class is own_adapter


@pytest.mark.parametrize("seed", ["x", 1.5, None, -1, 2**63, True])
def test_seeds_that_are_none(seed):
    with raises(SmartsError, "seed", values=[repr(seed)]):
        EnvSettings(["loop"], seed=seed)
    with raises(SmartsError, "here", values=[repr(seed)]):
        check_seed(seed, "here")


@pytest.mark.parametrize("seed", [0, 2**63 - 1, np.int64(3)])
def test_seeds(seed):
    assert EnvSettings(["loop"], seed=seed).seed == seed
    check_seed(seed, "here")


@pytest.mark.parametrize("path", [0, -1, 2.5, True])
def test_paths_have_points(path):
    with raises(InterfaceError, "Options", values=[path]):
        Options(path=path)


def test_rllib_configurations():
    with raises(SmartsError, "env_config", values=["agents", "agent_specs"]):
        RLlibHiWayEnv({"scenarios": ["loop"], "agents": 2, "agent_specs": 3})
    with raises(SmartsError, "env_config", values=["scenarios"]):
        RLlibHiWayEnv({})


def test_an_interface_is_enough_and_seeds_of_resets_are_checked():
    env = HiWayEnv(["loop"], {"a": AgentInterface(max_episode_steps=2)})
    try:
        for seed in (-1, 1.5):
            with raises(SmartsError, "reset", values=[seed]):
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
    for bad, value in (({"gaol": 1}, "'goal'"), ({"goal": "1"}, "'1'"), (4, 4)):
        with raises(ScenarioError, "reward", values=[value]):
            given_weights(bad)


@pytest.mark.parametrize(
    "keyword", ["observation", "adapter", "adapter_options", "action_mask", "num_envs", "sed"]
)
def test_hiway_env_takes_no_keywords_of_array_adapters(keyword):
    with pytest.raises(TypeError, match=keyword):
        HiWayEnv(["loop"], {"a": LANER}, **{keyword: None})


@pytest.mark.parametrize("keyword", ["action_mask", "worlds", "sed"])
def test_vector_env_takes_no_keywords_of_dict_environments(keyword):
    with pytest.raises(TypeError, match=keyword):
        VectorHiWayEnv(1, ["loop"], 1, **{keyword: None})


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("VectorHiWayEnv", lambda **options: VectorHiWayEnv(1, ["loop"], 1, **options)),
        ("SingleHiWayEnv", lambda **options: SingleHiWayEnv(["loop"], **options)),
        ("hiway_parallel_env", lambda **options: hiway_parallel_env(["loop"], 1, **options)),
    ],
)
def test_unknown_keywords_are_named_with_environment_and_remedy(name, make):
    for keyword, remedy in (
        ("rewrd", "'reward'"),
        ("trafic", "'traffic'"),
    ):
        with pytest.raises(TypeError) as raised:
            make(**{keyword: "x"})
        assert all(each in str(raised.value) for each in (name, keyword, remedy))


def test_environments_that_do_not_draw_say_what_does():
    with pytest.raises(TypeError, match=r"VectorHiWayEnv .*render_mode.* smarts-bench render"):
        VectorHiWayEnv(1, ["loop"], 1, render_mode="rgb_array")


@pytest.mark.parametrize("wrong", [None, "x"])
def test_a_reward_adapter_returns_a_number(wrong):
    spec = AgentSpec(interface=LANER, reward_adapter=lambda seen, reward: wrong)
    env = hiway_parallel_env(["loop"], {"a": spec})
    try:
        env.reset(seed=1)
        with raises(InterfaceError, "AgentSpec.reward_adapter", values=["'a'", repr(wrong)]):
            env.step({"a": 0})
    finally:
        env.close()


def test_a_parallel_environment_without_render_mode_warns():
    env = hiway_parallel_env(["loop"], 1)
    try:
        with pytest.warns(UserWarning, match="smarts-bench render"):
            env.render()
    finally:
        env.close()
