"""Social agents through the runner: requests by policy, failures, transfers of vehicles."""

import dataclasses

import numpy as np
import pytest

from smarts.agents import (
    Agent,
)
from smarts.agents.acting import Answer
from smarts.types.agent_states import AgentStatus
from smarts.types.vehicles import Owner
from tests.unit.env.social_stage import (
    SOCIAL,
    Answers,
    beside,
    start_of,
    trap,
)


def test_a_social_agent_drives_as_its_policy_says(play):
    seen = []

    class Brakes(Agent):
        made = 0

        def __init__(self):
            Brakes.made += 1

        def act(self, obs):
            seen.append(obs)
            return "slow_down"

    played = play(Brakes, beside)
    assert Brakes.made == 0
    played.reset()
    vehicle = played.slot
    assert played.world.vehicles.owner[0, vehicle] == Owner.AGENT
    start_speed = float(played.world.vehicles.speed[0, vehicle])
    played.step(30)
    assert Brakes.made == 1
    assert len(seen) == 30
    assert seen[0].ego_vehicle_state.position[:2] == pytest.approx(start_of(1)[:2], abs=1e-6)
    assert played.world.vehicles.speed[0, vehicle] < min(start_speed, 0.5) + 0.1
    played.reset(1)
    played.step(2)
    assert Brakes.made == 2, "the next episode's agent is another"


def test_answers_of_the_past_are_dropped(play):
    answers = Answers()
    played = play(answers, beside)
    played.reset()
    ((number, first),) = answers.asked
    assert (number, first.batch.hold.tolist(), first.batch.is_first.tolist()) == (0, [2], [True])
    played.step()
    assert not played.runner.actions.given[0, SOCIAL], "no answer has come"
    answers.ready = [Answer(0, answers.asked[-1][1], ["slow_down"])]
    played.step()
    assert played.runner.actions.given[0, SOCIAL]
    assert played.runner.actions.values[0, SOCIAL, 0] == 1
    assert not answers.asked[-1][1].batch.is_first[0]
    last = answers.asked[-1][1]
    played.reset(1)
    answers.ready = [Answer(0, last, ["keep_lane"])]
    played.step()
    assert not played.runner.actions.given[0, SOCIAL], "an answer of the last episode"


@pytest.mark.parametrize(
    ("action", "told"),
    [
        ("fly", "fly"),
        (7, "7"),
        (None, "None"),
        (np.array([]), "[]"),
        (np.full(2, np.nan), "cannot act"),
    ],
)
def test_an_agent_whose_answer_is_no_action_fails_alone(play, action, told):
    asked = []
    played = play(lambda seen: asked.append(seen) or (action if len(asked) > 3 else "keep_lane"), beside)
    played.reset()
    played.step(3)
    assert played.runner.social_failures == {}
    played.step()
    failures = played.runner.take_social_failures()
    assert [*failures] == [0]
    assert told in failures[0]["social"]
    assert not played.runner.actions.given[0, SOCIAL]
    played.step(10)
    assert played.runner.social_failures == {}, "told once"
    assert len(asked) == 4, "not asked again"
    assert played.world.agents.state[0, SOCIAL] == AgentStatus.ACTIVE
    assert played.world.vehicles.speed[0, played.slot] > 0, "the fallback drives"
    played.reset(1)
    played.step(2)
    assert len(asked) == 5, "the next episode's agent is another, and fails at once"


def test_a_vehicle_that_came_from_traffic_goes_back_when_its_agent_fails(play):
    played = play(lambda seen: "fly", trap())
    played.reset()
    world = played.world
    for _ in range(120):
        played.step()
        if played.runner.social_failures:
            break
    assert world.agents.release_step[0, SOCIAL] == world.step[0] - 1
    assert not played.runner.actions.given[0, SOCIAL]


@pytest.mark.parametrize("period", [1, 5])
def test_social_agents_decide_while_all_egos_wait(play, period):
    answers = Answers()

    def waiting(agents):
        ego, social = beside(agents)
        return dataclasses.replace(ego, entry_time=3.0), social

    played = play(answers, waiting, period=period)
    played.reset()
    entered = int(played.world.step[0])
    assert entered >= 30
    assert [int(request.batch.step[0]) for _, request in answers.asked] == [*range(entered + 1)]
