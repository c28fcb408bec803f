"""Goals, via points, traffic lights."""

import math

import pytest

from smarts.agents.options import Signals
from smarts.sensors.mission import MissionAndGoal
from smarts.sensors.signals import SignalsAhead
from smarts.sensors.via_data import ViaPoints
from smarts.types.mission import AgentMission, GoalKind, Via
from smarts.types.traffic import Signal
from tests.maps import Road, graph_of
from tests.unit.sensors.seeing import RADIUS, TO_THE_LEFT, at_crossing, in_bend, on_bend, seen
from tests.worlds import Car, world_of


def test_goal_in_a_curve():
    mission = AgentMission(
        ("bend",), GoalKind.POSITION, (0.0, RADIUS), goal_radius=3.0, laps=2, route_length=40.0
    )
    made = in_bend(on_bend(0.5, mission=mission))
    made.world.agents.lap[0, 0] = 1
    goal = seen(MissionAndGoal(), made)
    assert (goal["goal"], goal["goal_radius"], goal["route_length"]) == (GoalKind.POSITION, 3.0, 40.0)
    assert goal["goal_position"].tolist() == [0.0, RADIUS]
    assert (goal["laps"], goal["lap"]) == (2, 1)
    # Counted by the shorter lane, the left one.
    assert goal["remaining"] == pytest.approx((math.pi / 2 - 0.5) * (RADIUS - 3.2), abs=0.05)


def vias_in_bend():
    def via(angle, lane):
        radius = RADIUS - 3.2 * lane
        return Via((radius * math.cos(angle), radius * math.sin(angle)), lane, 2.0, 8.0 + lane)

    return tuple(via(angle, lane) for angle, lane in ((1.5, 0), (0.6, 1), (0.3, 0)))


def test_via_points_in_a_curve_come_by_distance():
    made = in_bend(on_bend(0.25, mission=AgentMission(("bend",), vias=vias_in_bend())), vias=3)
    made.world.agents.via_hit[0, 0, 2] = True
    near = seen(ViaPoints(), made)
    assert near["count"] == 3
    assert near["lane"][:3].tolist() == near["lane_index"][:3].tolist() == [0, 1, 0]
    assert near["required_speed"][:3].tolist() == [8.0, 9.0, 8.0]
    assert near["hit"][:3].tolist() == [1, 0, 0]
    assert near["position"][0] == pytest.approx([RADIUS * math.cos(0.3), RADIUS * math.sin(0.3)])


def test_via_points_behind_a_junction_are_seen_when_near():
    via = Via((40.0, -1.6), lane=-1, radius=2.0, speed=5.0)
    mission = AgentMission(("west_in", "east_out"), vias=(via,))
    assert seen(ViaPoints(), at_crossing(Car(-0.5, -1.6, mission=mission)))["count"] == 0
    assert seen(ViaPoints(), at_crossing(Car(0.5, -1.6, mission=mission)))["count"] == 1


def lights(made, **shown):
    """Let lanes out of the west show lights, by where they lead to."""
    graph = made.atlas.graphs[0]
    for lane in graph.successors(graph.lane_number("west_in", 0)):
        leads_to = graph.lane_ids[graph.successors(lane)[0]].partition("_")[0]
        made.world.signals[0, lane] = shown.get(leads_to, Signal.NONE)
    return made


def test_the_light_of_the_own_way_is_seen():
    made = at_crossing(Car(-30.0, -1.6, mission=TO_THE_LEFT))
    ahead = seen(SignalsAhead(), lights(made, north=Signal.STOP, east=Signal.GO))
    assert ahead["count"] == 1
    assert ahead["state"].tolist() == [Signal.STOP, 0, 0, 0]
    assert ahead["stop_point"][0] == pytest.approx([-10.0, -1.6])
    assert ahead["distance"][0] == pytest.approx(20.0)


def test_lights_are_seen_from_so_far():
    made = at_crossing(Car(-30.0, -1.6, mission=TO_THE_LEFT))
    lights(made, north=Signal.STOP)
    assert seen(SignalsAhead(Signals(lookahead=19.9)), made)["count"] == 0
    assert seen(SignalsAhead(Signals(lookahead=20.1)), made)["count"] == 1


def test_off_the_route_all_lights_ahead_are_seen():
    made = at_crossing(Car(-30.0, -1.6, mission=AgentMission(("south_in", "north_out"))))
    ahead = seen(SignalsAhead(), lights(made, north=Signal.STOP, east=Signal.GO, south=Signal.CAUTION))
    assert sorted(ahead["state"].tolist()) == [0, Signal.STOP, Signal.CAUTION, Signal.GO]


def test_distance_to_a_light_is_along_the_curve():
    angles = [angle * 0.05 for angle in range(32)]
    curve = [(RADIUS * math.cos(angle), RADIUS * math.sin(angle)) for angle in angles]
    end = curve[-1]
    roads = {"bend": Road(curve), "on": Road([(end[0] - 10, end[1] + 1), (end[0] - 50, end[1] + 1)])}
    graph = graph_of(roads, [(("bend", 0), ("on", 0))])
    made = world_of([on_bend(0.35, mission=AgentMission(("bend", "on")))], maps=[graph])
    made.world.signals[0, graph.successors(0)[0]] = Signal.CAUTION
    ahead = seen(SignalsAhead(), made)
    assert ahead["distance"][0] == pytest.approx(1.2 * RADIUS, abs=0.05)
    assert ahead["stop_point"][0] == pytest.approx(end)
