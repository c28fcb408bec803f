"""Events and the episodes that they end, by hand: on straight roads and one crossing, a step at a time."""

import math

import numpy as np
import pytest

from smarts.agents.rules import AliveRule
from smarts.roads.lane_graph import LaneKind
from smarts.types.agent_states import UNSET, AgentStatus
from smarts.types.events import Event, Outcome
from smarts.types.mission import AgentMission, GoalKind
from tests import maps
from tests.maps import Road, graph_of
from tests.unit.sim.stage import AGENT_STATES, ROAD, Stage
from tests.worlds import Car


def test_collision():
    stage = Stage([Car(10.0, 0.0, mission=ROAD), Car(15.0, 0.0)])
    assert stage.step((11.0, 0.0), (15.0, 0.0), hits=[(0, 1)]) == Event.COLLISION
    assert stage.agents.state[0, 0] == AgentStatus.DONE
    assert stage.agents.outcome[0, 0] == Outcome.COLLISION
    assert stage.events.just_done[0].tolist() == [True, False, False, False]
    assert stage.events.terminated[0, 0]
    assert not stage.events.truncated[0, 0]
    assert stage.events.finished[0]


def test_off_road_is_when_the_centre_leaves_and_on_shoulder_when_a_corner_does():
    # The road's right edge is 1.6 m right of lane 0, a car's side 0.9 m from its centre.
    stage = Stage([Car(10.0, 0.0, mission=ROAD)])
    assert stage.step((11.0, -0.65)) == Event.NONE
    assert stage.step((12.0, -0.75)) == Event.ON_SHOULDER
    assert stage.agents.state[0, 0] == AgentStatus.ACTIVE
    assert stage.step((13.0, -1.65)) == Event.ON_SHOULDER | Event.OFF_ROAD
    assert stage.agents.outcome[0, 0] == Outcome.OFF_ROAD
    assert stage.events.terminated[0, 0]


def test_a_shoulder_lane_is_no_road():
    graph = graph_of(
        {"side": Road([(0, -3.2), (200, -3.2)], kind=LaneKind.SHOULDER), "road": Road([(0, 0), (200, 0)])}
    )
    stage = Stage([Car(10.0, 0.0, mission=ROAD)], graph=graph)
    assert stage.step((11.0, -1.0)) == Event.ON_SHOULDER
    assert stage.step((12.0, -3.2)) == Event.ON_SHOULDER | Event.OFF_ROAD


def two_ways():
    """Return a road to the east and, left of it, one to the west, each with two lanes."""
    return graph_of({"road": Road([(0, 0), (200, 0)], 2), "back": Road([(200, 9.6), (0, 9.6)], 2)})


def test_wrong_way_in_the_own_lane():
    stage = Stage([Car(10.0, 0.0, mission=ROAD)])
    assert stage.step((11.0, 0.0, math.radians(89.0))) & Event.WRONG_WAY == Event.NONE
    assert stage.step((11.0, 0.0, math.radians(91.0))) & Event.WRONG_WAY
    assert stage.step((11.0, 0.0, math.radians(-91.0))) & Event.WRONG_WAY


def test_the_other_side_of_the_own_road_is_wrong_way_but_not_off_route():
    stage = Stage([Car(10.0, 0.0, mission=ROAD)], graph=two_ways())
    for x in range(11, 30):
        assert stage.step((float(x), 6.4)) == Event.WRONG_WAY
    # Round and back along the other side: still the same road.
    assert stage.step((29.0, 9.6, math.pi)) == Event.NONE
    assert stage.agents.off_route_since[0, 0] == UNSET


def test_inside_a_junction_there_is_no_wrong_way():
    mission = AgentMission(route=("west_in", "east_out"))
    stage = Stage([Car(-20.0, -1.6, mission=mission)], graph=maps.crossing())
    assert stage.step((0.0, -1.6, math.pi)) & Event.WRONG_WAY == Event.NONE


def test_off_route_after_half_a_second():
    mission = AgentMission(route=("west_in", "north_out"), goal=GoalKind.POSITION, goal_position=(1.6, 80.0))
    stage = Stage([Car(-12.0, -1.6, mission=mission)], graph=maps.crossing())
    # It goes straight on, to the east.
    assert stage.step((15.0, -1.6)) == Event.NONE
    assert stage.agents.off_route_since[0, 0] == 1
    for x in (16.0, 17.0, 18.0, 19.0):
        assert stage.step((x, -1.6)) == Event.NONE
    assert stage.step((20.0, -1.6)) == Event.OFF_ROUTE
    assert stage.agents.outcome[0, 0] == Outcome.OFF_ROUTE


@pytest.mark.parametrize("mission", [AgentMission(), AgentMission(route=("west_in", "north_out"))])
def test_without_a_goal_nobody_is_off_route(mission):
    stage = Stage([Car(-12.0, -1.6, mission=mission)], graph=maps.crossing())
    for x in range(15, 25):
        assert stage.step((float(x), -1.6)) == Event.NONE


def test_time_out_counts_from_entry():
    stage = Stage([Car(10.0, 0.0, mission=ROAD)], max_steps=3)
    stage.agents.entry_step[0, 0] = 2
    assert [stage.step((10.0 + step, 0.0)) for step in range(4)] == [Event.NONE] * 4
    assert stage.step((15.0, 0.0)) == Event.REACHED_MAX_EPISODE_STEPS
    assert stage.agents.outcome[0, 0] == Outcome.TIME_OUT
    assert stage.events.truncated[0, 0]
    assert not stage.events.terminated[0, 0]


def three_agents():
    return [Car(10.0 + 10 * agent_id, 0.0, mission=ROAD) for agent_id in range(3)]


ALIVE = Event.COLLISION | Event.AGENTS_ALIVE_DONE


def test_too_few_agents_left():
    rule = AliveRule(0, np.array([False, True, True, False]), 2)
    stage = Stage(three_agents(), ending=ALIVE, alive=[rule])
    places = [(11.0, 0.0), (21.0, 0.0), (31.0, 0.0)]
    assert stage.step(*places) == Event.NONE
    assert stage.step(*places, hits=[(2, 5)]) == Event.AGENTS_ALIVE_DONE
    assert stage.agents.outcome[0, :3].tolist() == [Outcome.OTHER, Outcome.NONE, Outcome.COLLISION]
    assert stage.events.truncated[0, :3].tolist() == [True, False, False]
    assert stage.events.terminated[0, :3].tolist() == [False, False, True]
    assert not stage.events.finished[0]


def test_who_is_missed_is_counted_once_a_step():
    # Each ends when another one is gone: 2 goes, then 0 for want of 2, and only then 1 for want of 0.
    rules = [AliveRule(0, np.arange(AGENT_STATES) == 2, 1), AliveRule(1, np.arange(AGENT_STATES) == 0, 1)]
    stage = Stage(three_agents(), ending=ALIVE, alive=rules)
    places = [(11.0, 0.0), (21.0, 0.0), (31.0, 0.0)]
    stage.step(*places, hits=[(2, 5)])
    assert stage.agents.state[0, :3].tolist() == [AgentStatus.DONE, AgentStatus.ACTIVE, AgentStatus.DONE]
    stage.step(*places)
    assert stage.agents.state[0, 1] == AgentStatus.DONE
    assert stage.agents.outcome[0, 1] == Outcome.OTHER


def test_agents_of_one_simulation_have_their_own_rules():
    stage = Stage([Car(10.0, 0.0, mission=ROAD), Car(30.0, 0.0, mission=ROAD)])
    stage.rules.ending[1] = Event.WRONG_WAY
    stage.step((11.0, -3.0), (31.0, -3.0))
    assert stage.agents.state[0, :2].tolist() == [AgentStatus.DONE, AgentStatus.ACTIVE]
    stage.step((11.0, -3.0), (31.0, 0.0, math.pi))
    assert stage.agents.outcome[0, 1] == Outcome.OTHER_TERMINAL
    assert stage.events.just_done[0].tolist() == [False, True, False, False]
    assert stage.events.finished[0]


def test_who_only_watches_is_not_ended():
    stage = Stage([Car(10.0, 0.0, mission=ROAD)])
    stage.agents.state[0, 0] = AgentStatus.SHADOWING
    assert stage.step((11.0, -3.0)) & Event.OFF_ROAD
    assert stage.agents.state[0, 0] == AgentStatus.SHADOWING


def test_an_overlap_at_the_start_voids_the_episode():
    stage = Stage([Car(10.0, 0.0, mission=ROAD), Car(30.0, 0.0, mission=ROAD)])
    stage.agents.state[0, 2] = AgentStatus.WAITING
    stage.contacts.partner[0, 1] = 7
    events = stage.judge.reset(stage.contacts, stage.rows)
    assert stage.agents.outcome[0].tolist() == [Outcome.INVALID] * 3 + [Outcome.NONE]
    assert stage.agents.state[0].tolist() == [
        AgentStatus.DONE,
        AgentStatus.DONE,
        AgentStatus.VACANT,
        AgentStatus.VACANT,
    ]
    assert events.truncated[0].tolist() == [True, True, False, False]
    assert not events.terminated.any()
    assert events.finished[0]
