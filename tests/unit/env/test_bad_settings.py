"""Mistakes in an environment's arguments are named, with a remedy, before anything is built."""

import pytest

from smarts.agents import AgentInterface, AgentSpec
from smarts.agents.benchmark import benchmark_interface
from smarts.agents.options import InterfaceError
from smarts.env import HiWayEnv, RLlibHiWayEnv, SingleHiWayEnv, VectorHiWayEnv
from smarts.errors import OwnCodeError, ScenarioError, SmartsError, UnknownNameError
from tests.raising import raises

LANER = benchmark_interface()


@pytest.mark.parametrize(
    ("bad", "kind", "place", "value"),
    [
        ({"scenarios": "loop"}, InterfaceError, "", "['loop']"),
        ({"traffic": "light"}, InterfaceError, "", "traffic is 'light'"),
        ({"agents": {}}, InterfaceError, "", "agents is {}"),
        ({"agents": {"a": AgentSpec()}}, InterfaceError, "agents", "'a'"),
        ({"decision_interval": "5"}, InterfaceError, "", "decision_interval is '5'"),
        ({"num_envs": 0}, InterfaceError, "", "num_envs is 0"),
        ({"simulation": {"dt": 0.1}}, InterfaceError, "", "simulation is {'dt': 0.1}"),
        ({"seed": -1}, InterfaceError, "", "seed is -1"),
        ({"observation": "benchmrk"}, SmartsError, "observation", "benchmrk"),
        ({"observation": ["gaol"]}, UnknownNameError, "", "gaol"),
        ({"reward": {"gaol": 1}}, ScenarioError, "reward", "gaol"),
        ({"reward": "no_such_module:A"}, OwnCodeError, "", "no_such_module"),
        ({"adapter": "paper"}, InterfaceError, "adapter", "paper"),
        ({"adapter_options": {"factor": 2}}, InterfaceError, "adapter_options", "factor"),
    ],
)
def test_settings(bad, kind, place, value):
    with raises(kind, place, values=[value]):
        VectorHiWayEnv(**{"scenarios": ["loop"], "num_envs": 1, **bad})


@pytest.mark.parametrize(
    ("make", "keyword", "said"),
    [
        (lambda **options: SingleHiWayEnv(["loop"], **options), "trafic", "'traffic'"),
        (lambda **options: SingleHiWayEnv(["loop"], **options), "agents", "'agent'"),
        (lambda **options: HiWayEnv(["loop"], {"a": LANER}, **options), "headles", "'headless'"),
        (lambda **options: HiWayEnv(["loop"], {"a": LANER}, **options), "reward", "'reward'"),
        (lambda **options: VectorHiWayEnv(1, ["loop"], 1, **options), "render_mode", "smarts-bench render"),
        (lambda **options: RLlibHiWayEnv({"scenarios": ["loop"], **options}), "agent_spec", "'agents'"),
        (lambda **options: RLlibHiWayEnv(options), "agents", "scenarios is missing"),
        (lambda **options: SingleHiWayEnv(["loop"], **options), "num_envs", "'num_envs'"),
    ],
)
def test_keywords_that_an_environment_does_not_have(make, keyword, said):
    with raises(InterfaceError, values=[said]):
        make(**{keyword: 1})


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
