"""Specs and policies, as the paper and the original write them."""

import pickle

import pytest

from smarts.agents import Agent, AgentInterface, AgentPolicy, AgentSpec, AgentType


class Recorder(Agent):
    def __init__(self, *given, **named):
        self.given, self.named = given, named

    def act(self, obs):
        return obs


def test_the_papers_listing():
    spec = AgentSpec(
        interface=AgentInterface.from_type(AgentType.Laner),
        policy_params={"policy_function": lambda _: "keep_lane"},
        policy_builder=AgentPolicy.from_function,
    )
    assert spec.build_agent().act(None) == "keep_lane"
    assert spec.agent_builder == spec.policy_builder == AgentPolicy.from_function


@pytest.mark.parametrize(
    ("params", "given", "named"),
    [
        (None, (), {}),
        ({"a": 1}, (), {"a": 1}),
        ([1, 2], (1, 2), {}),
        (3, (3,), {}),
    ],
)
def test_how_parameters_are_given(params, given, named):
    agent = AgentSpec(agent_builder=Recorder, agent_params=params).build_agent()
    assert (agent.given, agent.named) == (given, named)


def test_replacing_under_either_name():
    spec = AgentSpec(agent_builder=Recorder, agent_params=1)
    for change in ({"policy_params": 2}, {"agent_params": 2}):
        changed = spec.replace(**change)
        assert changed.agent_params == changed.policy_params == 2
        assert changed.agent_builder is Recorder
    assert spec.agent_params == 1


def test_specs_travel():
    spec = AgentSpec(AgentInterface(), Recorder, 1)
    assert pickle.loads(pickle.dumps(spec)) == spec
