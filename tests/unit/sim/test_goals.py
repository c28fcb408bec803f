"""Goals, laps and via points by hand: on straight roads and a ring, a step at a time."""

import math

import numpy as np
import pytest

from smarts.types.events import Event, Outcome
from smarts.types.mission import AgentMission, GoalKind, Via
from tests import maps
from tests.maps import Road, graph_of
from tests.unit.sim.stage import ROAD, Stage
from tests.worlds import Car

POINT = AgentMission(route=("road",), goal=GoalKind.POSITION, goal_position=(150.0, 0.0), goal_radius=2.0)


@pytest.mark.parametrize(
    ("begin", "end", "reached"),
    [
        ((147.5, 0.0), (147.9, 0.0), False),
        ((147.5, 0.0), (148.1, 0.0), True),
        # At 60 m/s it is past the goal within one step.
        ((147.0, 0.0), (153.0, 0.0), True),
        ((147.0, 1.9), (153.0, 1.9), True),
        ((147.0, 2.1), (153.0, 2.1), False),
    ],
)
def test_a_goal_with_a_radius(begin, end, reached):
    stage = Stage([Car(*begin, mission=POINT)])
    assert (stage.step(end) == Event.REACHED_GOAL) == reached
    if reached:
        assert stage.agents.outcome[0, 0] == Outcome.GOAL
        assert stage.events.terminated[0, 0]


LINE = AgentMission(route=("road",), goal=GoalKind.LANE_LINE, goal_lane=1, goal_s=150.0)


@pytest.mark.parametrize("aside", [0.0, 6.0, 60.0])
@pytest.mark.parametrize("goal", [GoalKind.POSITION, GoalKind.LAPS])
def test_beside_the_road_there_is_no_goal(goal, aside):
    mission = AgentMission(
        route=("road",), goal=goal, goal_lane=0, goal_s=150.0, goal_position=(150.0, 0.0),
        goal_radius=2.0, vias=(Via((148.0, 0.0), 0, 80.0, 10.0),),
    )  # fmt: skip
    stage = Stage([Car(20.0, 0.0, mission=mission)], ending=int(Event.REACHED_GOAL))
    events = Event.NONE
    for x in (21.0, 60.0, *np.arange(140.0, 170.0, 2.0)):
        events |= stage.step((x, -aside if x > 21.0 else 0.0))
        if aside:
            assert stage.agents.remaining[0, 0] == 129.0
    assert bool(events & Event.REACHED_GOAL) == (aside == 0.0)
    assert bool(events & Event.VIA_HIT) == (aside == 0.0)
    assert not aside or not events & (Event.MISSED_GOAL | Event.LAP_COMPLETED)
    if aside and goal != GoalKind.LAPS:
        # Back on the road behind the line, the goal is missed.
        assert stage.step((172.0, 0.0)) & Event.MISSED_GOAL
    assert stage.agents.lap[0, 0] == (goal == GoalKind.LAPS and aside == 0.0)


def test_across_the_line_in_another_lane_is_a_miss():
    stage = Stage([Car(148.0, 0.0, mission=LINE)])
    assert stage.step((150.1, 0.0)) == Event.NONE
    # To change into the goal lane behind the line does not help.
    assert stage.step((152.0, 3.2)) == Event.NONE
    assert stage.step((154.9, 3.2)) == Event.NONE
    assert stage.step((155.1, 3.2)) == Event.MISSED_GOAL
    assert stage.agents.outcome[0, 0] == Outcome.MISSED_GOAL
    assert stage.events.terminated[0, 0]


@pytest.mark.parametrize(("goal_lane", "own_lane"), [(3, 0), (0, 3)])
def test_a_line_across_a_bend_is_square_to_it(goal_lane, own_lane):
    # Around (0, 0), lane i has the radius 30 m - 3.2 i: the innermost one is 15 m shorter than the outermost.
    radii = [30.0 - 3.2 * lane for lane in range(4)]
    mission = AgentMission(
        route=("bend",), goal=GoalKind.LANE_LINE, goal_lane=goal_lane, goal_s=1.0 * radii[goal_lane]
    )

    def place(angle):
        radius = radii[own_lane]
        return radius * math.cos(angle), radius * math.sin(angle), angle + math.pi / 2

    stage = Stage([Car(*place(0.1), mission=mission)], graph=maps.bend(4))
    missed = 1.0 + 5.0 / radii[own_lane]
    assert [stage.step(place(angle)) for angle in (0.6, 0.99, 1.01, missed - 0.01)] == [Event.NONE] * 4
    assert stage.step(place(missed + 0.01)) == Event.MISSED_GOAL


def test_a_line_at_the_very_end_where_roads_meet_at_an_angle():
    # Left of the middle of a left bend one is on the next road before one has passed the end of the last.
    turn = math.radians(30.0)
    far = 100.0 + 80.0 * math.cos(turn), 80.0 * math.sin(turn)
    graph = graph_of({"first": Road([(0, 0), (100, 0)]), "second": Road([(100, 0), far])})
    mission = AgentMission(goal=GoalKind.LANE_LINE, goal_lane=0, goal_s=100.0)
    stage = Stage([Car(98.6, 0.9, mission=mission)], graph=graph)
    assert not stage.step((99.2, 0.9)) & Event.REACHED_GOAL
    assert stage.step((99.7, 1.0, turn)) & Event.REACHED_GOAL
    assert stage.world.vehicles.lane[0, 0] == 1


def ring():
    """Return a road of 100 m and a round one of 220 m that leads back to it."""
    return graph_of(
        {"side": Road([(0, 0), (100, 0)]), "round": Road([(110, 10), (110, 60), (-10, 60), (-10, 10)])},
        [(("side", 0), ("round", 0)), (("round", 0), ("side", 0))],
    )


def test_a_goal_that_the_route_passes_twice():
    # First come by, then arrive.
    mission = AgentMission(
        route=("side", "round", "side"),
        goal=GoalKind.POSITION,
        goal_position=(50.0, 0.0),
        goal_lane=0,
        goal_s=50.0,
    )
    stage = Stage([Car(40.0, 0.0, mission=mission)], graph=ring())
    assert [stage.step((x, 0.0)) for x in (49.0, 51.0, 60.0)] == [Event.NONE] * 3
    for place in (
        (110.0, 30.0, math.pi / 2),
        (50.0, 60.0, math.pi),
        (-10.0, 20.0, -math.pi / 2),
        (40.0, 0.0),
    ):
        assert stage.step(place) == Event.NONE
    assert stage.step((48.5, 0.0)) == Event.REACHED_GOAL


def test_off_the_map_at_the_end_of_a_road():
    for goal in (GoalKind.ENDLESS, GoalKind.OFF_MAP):
        stage = Stage([Car(198.0, 0.0, mission=AgentMission(goal=goal))])
        assert stage.step((199.9, 0.0)) == Event.NONE | Event.ON_SHOULDER
        assert stage.step((201.0, 0.0)) == Event.REACHED_GOAL
    assert Stage([Car(198.0, 0.0, mission=ROAD)]).step((201.0, 0.0)) & Event.OFF_ROAD
    # Beside the road, or over its begin, is off road for everybody.
    endless = Stage([Car(198.0, 0.0, mission=AgentMission())])
    assert endless.step((150.0, -3.0)) & Event.OFF_ROAD
    assert Stage([Car(1.0, 0.0, mission=AgentMission())]).step((-1.0, 0.0)) & Event.OFF_ROAD
    beside = Stage([Car(190.0, 0.0, mission=AgentMission())], ending=int(Event.REACHED_GOAL))
    assert beside.step((198.0, -2.5)) & Event.OFF_ROAD
    assert beside.step((201.0, -2.5)) & Event.OFF_ROAD


def test_a_vehicle_that_goes_back_and_forth_has_driven_one_lap():
    mission = AgentMission(
        route=("side", "round") * 2 + ("side",), goal=GoalKind.LAPS, laps=2, goal_lane=0, goal_s=50.0
    )
    stage = Stage([Car(60.0, 0.0, mission=mission)], graph=ring())
    around = (50.0, 60.0, math.pi), (-10.0, 20.0, -math.pi / 2), (40.0, 0.0)
    for lap in (1, 2):
        assert [stage.step(place) for place in around] == [Event.NONE] * 3
        for x in (49.0, 51.0, 49.0, 51.0):
            events = stage.step((x, 0.0))
            if lap == 2 and x == 51.0:
                assert events == Event.LAP_COMPLETED | Event.REACHED_GOAL
                return
            assert stage.agents.lap[0, 0] <= lap
        assert stage.agents.lap[0, 0] == lap


@pytest.mark.parametrize("laps", [1, 2])
@pytest.mark.parametrize(("y", "reached"), [(10.1, False), (9.8, True), (7.0, True)])
def test_laps_to_the_very_end_of_a_road(laps, y, reached):
    mission = AgentMission(
        route=("side", "round") * laps, goal=GoalKind.LAPS, laps=laps, goal_lane=1, goal_s=220.0
    )
    stage = Stage([Car(40.0, 0.0, mission=mission)], graph=ring())
    south, goal = -math.pi / 2, Event.LAP_COMPLETED | Event.REACHED_GOAL
    for lap in range(laps):
        places = (50.0, 60.0, math.pi), (-10.0, 20.0, south), (-10.0, 10.5, south)
        assert [stage.step(place) for place in places] == [Event.NONE] * 3
        found = stage.step((-9.9, y, south)) & goal
        is_last = lap == laps - 1
        assert found == ((goal if is_last else Event.LAP_COMPLETED) if reached else Event.NONE)
        if not reached:
            return
        assert stage.agents.lap[0, 0] == lap + 1
        assert stage.step((95.0, 0.0)) == Event.NONE
    # Round to the begin again, it is still behind the end.
    assert stage.agents.remaining[0, 0] == 0.0


def test_vias_are_hit_once_in_every_lap():
    vias = (Via((60.0, 0.0), 0, 1.6, 5.0), Via((70.0, 5.0), 0, 1.0, 5.0))
    mission = AgentMission(
        route=("side", "round") * 2, goal=GoalKind.LAPS, laps=2, goal_lane=1, goal_s=200.0, vias=vias
    )
    stage = Stage([Car(40.0, 0.0, mission=mission)], graph=ring())
    south, lap_ends = -math.pi / 2, []
    for _ in range(2):
        assert stage.step((57.0, 0.0)) == Event.NONE
        assert stage.step((61.0, 0.0)) == Event.VIA_HIT
        assert stage.step((60.5, 0.0)) == Event.NONE
        assert stage.agents.via_hit[0, 0].tolist() == [True, False]
        assert stage.step((50.0, 60.0, math.pi)) == Event.NONE
        assert stage.step((-10.0, 40.0, south)) == Event.NONE
        lap_ends.append(stage.step((-10.0, 20.0, south)))
    assert lap_ends == [Event.LAP_COMPLETED, Event.LAP_COMPLETED | Event.REACHED_GOAL]
    # What was passed in the last lap is still so when the episode ends.
    assert stage.agents.via_hit[0, 0].tolist() == [True, False]
