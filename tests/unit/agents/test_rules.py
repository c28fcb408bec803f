"""What interfaces mean for the step."""

import numpy as np
import pytest

from smarts.agents import (
    ActionSpaceType,
    AgentInterface,
    AgentsAliveDoneCriteria,
    AgentsListAlive,
    DoneCriteria,
    EventConfiguration,
)
from smarts.agents.rules import agent_rules, alive_rules
from smarts.types.events import Event
from smarts.types.interface import ENDING


def test_rules_of_an_interface():
    interface = AgentInterface(
        action=ActionSpaceType.Lane,
        max_episode_steps=600,
        event_configuration=EventConfiguration(not_moving_time=20, not_moving_distance=2.0),
        done_criteria=DoneCriteria(off_route=False, not_moving=True, wrong_way=True),
    )
    rules = agent_rules([None, interface], dt=0.05)
    assert rules.action[1] == ActionSpaceType.Lane
    assert rules.max_steps[1] == 600
    assert (rules.not_moving_steps[1], rules.not_moving_distance[1]) == (400, 2.0)
    assert rules.ending[1] == (ENDING | Event.NOT_MOVING | Event.WRONG_WAY) & ~Event.OFF_ROUTE


@pytest.mark.parametrize(("time", "steps"), [(0, 1), (np.float32(2.0), 2000), (np.inf, 2**31 - 1)])
def test_times_of_rest(time, steps):
    interface = AgentInterface(event_configuration=EventConfiguration(not_moving_time=time))
    assert agent_rules([interface], dt=0.001).not_moving_steps.tolist() == [steps]


def alive(**criteria):
    return AgentInterface(done_criteria=DoneCriteria(agents_alive=AgentsAliveDoneCriteria(**criteria)))


def test_how_many_must_be_left():
    lists = [AgentsListAlive(["a", "c"], 2)]
    interfaces = [
        AgentInterface(),
        alive(minimum_ego_agents_alive=1, minimum_total_agents_alive=3, agent_lists_alive=lists),
        None,
    ]
    rules = alive_rules(interfaces, ["a", "b", "c"], egos=2)
    assert [(rule.agent_id, rule.counted.tolist(), rule.minimum) for rule in rules] == [
        (1, [True, True, False], 1),
        (1, [True, True, True], 3),
        (1, [True, False, True], 2),
    ]
