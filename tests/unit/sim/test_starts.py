"""Missions of scenarios as agents: routes, goals, distances, and how agents are to enter."""

from types import SimpleNamespace

import numpy as np
import pytest

from smarts.errors import ScenarioError
from smarts.geometry.segments import inside_outline
from smarts.sim.schedule import Schedule
from smarts.sim.social_starts import Role, draw_start
from smarts.sim.starts import Shape, corridor_of, distance_along, draw_starts, free_flow_time
from smarts.sstudio import types as t
from smarts.sstudio.build import build_described
from smarts.types.mission import GoalKind
from smarts.types.vehicles import VehicleKind
from tests.maps import Road, crossing, graph_of, straight
from tests.raising import raises
from tests.unit.sim.test_map_matching import ring
from tests.unit.sstudio import sources


def starts_of(graph, *missions, shapes=None, variation=None, seed=1):
    built = SimpleNamespace(
        name="test", roads=lambda: graph, net_file=None, scenario=SimpleNamespace(start_variation=variation)
    )
    shapes = shapes or [Shape()] * len(missions)
    names = [f"ego-{number}" for number in range(len(missions))]
    generator = np.random.Generator(np.random.Philox(seed))
    return draw_starts(built, missions, names, shapes, generator)


def through(begin=("west_in", 0, 30), end=("east_out", 0, 20), **more):
    return t.Mission(t.Route(begin=begin, end=end), **more)


def test_a_route_to_a_goal():
    graph = crossing(length=80.0, gap=10.0)
    (start,) = starts_of(graph, through())
    mission = start.mission
    # The front bumper is 30 m along a road that begins at x = -90 m.
    assert start.pose == pytest.approx((-62.5, -1.6, 0.0))
    assert mission.route == ("west_in", "east_out")
    assert mission.goal == GoalKind.POSITION
    assert mission.goal_position == pytest.approx((30.0, -1.6))
    assert (mission.goal_lane, mission.goal_s) == (graph.lane_number("east_out", 0), 20.0)
    assert mission.route_length == pytest.approx(62.5 + 30.0)
    assert (start.entry_time, start.take_over) == (0.0, None)


@pytest.mark.parametrize(
    ("kind", "route"),
    [(VehicleKind.BUS, ("east", "middle", "west")), (VehicleKind.TRUCK, ("east", "up", "down", "west"))],
)
@pytest.mark.parametrize("is_social", [False, True])
def test_agents_take_ways_that_are_open_to_their_vehicles(tmp_path, kind, route, is_social):
    """The shorter way, over "middle", is closed to trucks."""
    mission = t.Mission(t.Route(("east", 0, 20), ("west", 0, "max")))
    built = build_described(sources.write_detour(tmp_path / "detour"), t.Scenario(ego_missions=[mission]))
    shape, generator = Shape(kind), np.random.default_rng(1)
    if is_social:
        start = draw_start(built, Role("social", mission, 0), shape, (), generator)
    else:
        (start,) = draw_starts(built, [mission], ["ego"], [shape], generator)
    assert start.mission.route == route


@pytest.mark.parametrize(
    "mission",
    [
        t.Mission(t.Route(("ab", 1, 20), ("bd", 0, "max"))),
        t.Mission(t.Route(("bd", 0, 20), ("bd", 0, "max"))),
        t.EndlessMission(("bd", 0, 20)),
    ],
)
def test_missions_that_are_closed_to_an_agents_vehicle_are_errors_before_the_first_episode(tmp_path, mission):
    built = build_described(sources.write_fork(tmp_path / "fork"), t.Scenario(ego_missions=[mission]))
    Schedule([built], ["ego"])
    with raises(ScenarioError, "mission 0", values=["'bd_0' is closed to vehicles of type 'truck'"]):
        Schedule([built], ["ego"], shapes=[Shape(VehicleKind.TRUCK)])


def test_free_flow_is_the_way_at_the_limit_after_speeding_up():
    graph = straight(length=200.0)  # 14 m/s
    assert free_flow_time(graph, ("road",), 0, 140.0, 14.0) == pytest.approx(10.0)
    # From standstill at 3 m/s^2 the driver loses half of the 14/3 s.
    assert free_flow_time(graph, ("road",), 0, 140.0, 0.0) == pytest.approx(10.0 + 14 / 6)
    assert free_flow_time(graph, (), 0, 0.0, 3.0) == 0.0


def test_a_goal_behind_the_start_takes_a_round():
    graph = ring()
    (start,) = starts_of(graph, through(("south", 0, 50), ("south", 0, 20)))
    assert start.mission.route == ("south", "east", "north", "west", "south")
    corridor = corridor_of(graph, start.mission.route)
    lane = graph.lane_number("south", 0)
    first = distance_along(corridor, graph, lane, 20.0)
    assert distance_along(corridor, graph, lane, 20.0, last=True) - first == pytest.approx(
        float(graph.length.sum()), abs=0.5
    )
    assert start.mission.route_length == pytest.approx(float(graph.length.sum()) - 30 + 2.5, abs=0.5)


def test_a_turn_without_a_way_has_a_goal_but_no_route():
    graph = graph_of({"there": Road([(0.0, 0.0), (100.0, 0.0)]), "back": Road([(100.0, 5.0), (0.0, 5.0)])})
    turn = through(("there", 0, 50), ("back", 0, 60), task=t.UTurn(initial_speed=8.0))
    (start,) = starts_of(graph, turn)
    assert start.mission.route == ()
    assert start.mission.goal == GoalKind.POSITION
    assert start.mission.goal_position == pytest.approx((40.0, 5.0))
    assert start.speed == 8.0


def test_a_trap_is_where_it_is_said_to_be():
    zone = t.PositionalZone(pos=(-50.0, -1.6), size=(20.0, 4.0))
    trap = t.TrapEntryTactic(
        start_time=3.0, wait_to_hijack_limit_s=7.0, zone=zone, exclusion_prefixes=("truck",)
    )
    (start,) = starts_of(crossing(), through(entry_tactic=trap))
    rule = start.take_over
    assert start.entry_time == 3.0
    assert (rule.patience, rule.spared, rule.vehicle) == (7.0, ("truck",), "")
    (area,) = rule.areas
    assert inside_outline(-59.0, -1.6, area, 0, len(area))
    assert not inside_outline(-61.0, -1.6, area, 0, len(area))


def test_a_trap_is_around_the_start_unless_said():
    trap = t.TrapEntryTactic(default_entry_speed=4.0)
    (start,) = starts_of(crossing(), through(entry_tactic=trap))
    assert start.take_over.patience == 0.0
    assert start.speed == 4.0
    (area,) = start.take_over.areas
    inside = [x for x in range(-90, -9) if inside_outline(float(x), -1.6, area, 0, len(area))]
    # From 5 m before the start at -60 m, for 20 m.
    assert (inside[0], inside[-1]) == (-65, -46)


def test_a_start_past_its_goal_is_drawn_anew():
    mission = through(("road", 0, 50), ("road", 0, 53))
    for seed in range(20):
        (start,) = starts_of(straight(), mission, variation=t.StartVariation(offset=8.0), seed=seed)
        assert 1.0 <= start.mission.route_length <= 53 - (42 - 2.5)


def test_starts_that_overlap_are_drawn_anew():
    """Two lanes that share their middle: the lanes' starts are not kept apart, so the draws decide."""
    graph = graph_of({"one": Road([(0.0, 0.0), (100.0, 0.0)]), "two": Road([(0.0, 1.0), (100.0, 1.0)])})
    missions = [through((name, 0, 50), (name, 0, 90)) for name in ("one", "two")]
    with raises(ScenarioError, values=["'ego-0'", "'ego-1'", 20]):
        starts_of(graph, *missions)
    variation = t.StartVariation(offset=8.0)
    for seed in range(20):
        one, two = starts_of(graph, *missions, variation=variation, seed=seed)
        assert abs(one.pose[0] - two.pose[0]) >= 5.0
