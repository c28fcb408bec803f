"""Mistakes in an environment's arguments are named, with a remedy, before anything is built."""

import numpy as np
import pytest

from smarts.agents import AgentInterface, AgentSpec
from smarts.agents.benchmark import benchmark_interface
from smarts.agents.options import InterfaceError
from smarts.env import HiWayEnv, RLlibHiWayEnv, SingleHiWayEnv, VectorHiWayEnv, hiway_parallel_env
from smarts.env.settings import EnvSettings
from smarts.errors import OwnCodeError, ScenarioError, SmartsError, UnknownNameError
from smarts.types.streams import check_seed
from tests.raising import raises

LANER = benchmark_interface()


@pytest.mark.parametrize(
    ("bad", "place", "value"),
    [
        ({"scenarios": "loop"}, "scenarios", ["loop"]),
        ({"scenarios": [42]}, "scenarios", 42),
        ({"traffic": "light"}, "traffic", "'light'"),
        ({"agents": 2.0}, "agents", 2.0),
        ({"agents": {}}, "agents", "no agents"),
        ({"agents": {"__all__": LANER}}, "agents", "__all__"),
        ({"agents": {"a": AgentSpec()}}, "agents", "'a'"),
        ({"decision_interval": "5"}, "decision_interval", "'5'"),
        ({"num_envs": 0}, "num_envs", 0),
        ({"simulation": {"dt": 0.1}}, "simulation", {"dt": 0.1}),
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
        ({"observation": ["gaol"]}, UnknownNameError, "", "gaol"),
        ({"reward": {"gaol": 1}}, ScenarioError, "reward", "gaol"),
        ({"reward": "no_such_module:A"}, OwnCodeError, "", "no_such_module"),
        ({"adapter": "paper"}, InterfaceError, "adapter", "paper"),
        ({"adapter": own_adapter, "adapter_options": {"fctor": 1}}, InterfaceError, "adapter", "fctor"),
        ({"adapter_options": {"factor": 2}}, InterfaceError, "adapter_options", "factor"),
    ],
)
def test_observations_rewards_and_adapters(bad, kind, place, value):
    with raises(kind, place, values=[value]):
        EnvSettings(["loop"], **bad)


@pytest.mark.parametrize("seed", ["x", 1.5, -1, 2**63])
def test_seeds_that_are_none(seed):
    with raises(SmartsError, "seed", values=[repr(seed)]):
        EnvSettings(["loop"], seed=seed)


@pytest.mark.parametrize("seed", [0, 2**63 - 1, np.int64(3)])
def test_seeds(seed):
    check_seed(seed, "here")


@pytest.mark.parametrize(
    ("config", "named"),
    [({}, "scenarios"), ({"scenarios": ["loop"], "agent_spec": {}}, "agent_specs")],
)
def test_rllib_configurations(config, named):
    with raises(SmartsError, "env_config", values=[named]):
        RLlibHiWayEnv(config)


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("HiWayEnv", lambda **options: HiWayEnv(["loop"], {"a": LANER}, **options)),
        ("VectorHiWayEnv", lambda **options: VectorHiWayEnv(1, ["loop"], 1, **options)),
        ("SingleHiWayEnv", lambda **options: SingleHiWayEnv(["loop"], **options)),
        ("hiway_parallel_env", lambda **options: hiway_parallel_env(["loop"], 1, **options)),
    ],
)
def test_unknown_keywords_are_named_with_environment_and_remedy(name, make):
    with pytest.raises(TypeError, match=f"{name} .*'trafic'.* 'traffic'"):
        make(trafic="x")


@pytest.mark.parametrize(
    ("make", "keyword", "said"),
    [
        (lambda **options: HiWayEnv(["loop"], {"a": LANER}, **options), "observation", "observation"),
        (lambda **options: HiWayEnv(["loop"], {"a": LANER}, **options), "headles", "'headless'"),
        (lambda **options: VectorHiWayEnv(1, ["loop"], 1, **options), "action_mask", "action_mask"),
        (lambda **options: VectorHiWayEnv(1, ["loop"], 1, **options), "render_mode", "smarts-bench render"),
    ],
)
def test_keywords_that_an_environment_does_not_have(make, keyword, said):
    with pytest.raises(TypeError, match=said):
        make(**{keyword: None})


def test_an_interface_is_enough_and_seeds_of_resets_are_checked(closing):
    env = closing(HiWayEnv(["loop"], {"a": AgentInterface(max_episode_steps=2)}))
    with raises(SmartsError, "reset", values=[-1]):
        env.reset(seed=-1)
    assert [*env.reset(seed=3)[0]] == ["a"]


def test_the_original_names_are_aliases(closing):
    assert set(closing(HiWayEnv(["loop"], agent_interfaces={"b": LANER})).agent_specs) == {"b"}
    for config in (
        {"agent_specs": {"b": LANER}, "headless": True, "sim_name": "x"},
        {"agents": {"b": LANER}},
    ):
        env = closing(RLlibHiWayEnv({"scenarios": ["loop"], **config}))
        assert env.possible_agents == ["b"]
    for given in ({}, {"agent_specs": {"a": LANER}, "agent_interfaces": {"b": LANER}}):
        with raises(InterfaceError, "HiWayEnv", values=["agent_specs"]):
            HiWayEnv(["loop"], **given)


def test_numbers_of_a_vector_reset(closing):
    env = closing(VectorHiWayEnv(2, ["loop"], 1))
    with raises(SmartsError, "reset", values=[-1]):
        env.reset(-1)
    env.reset(worlds=[5, 3], episode=7)
    assert [(start.world, start.episode) for start in env.episodes] == [(5, 7), (3, 7)]
