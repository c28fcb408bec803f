"""Bubbles in the step: phases, limits, overlaps and missions, computed by hand.

The front of a vehicle at 10 m/s goes on by 1 m in a step. The zone of most bubbles is x = 100 to 120 m, its
margin 10 m wide.
"""

import math

import numpy as np
import pytest
from shapely.geometry import box

from smarts.roads.scene import Scene
from smarts.sim.hold_missions import HoldMissions
from smarts.sim.starts import corridor_of
from smarts.sim.turn_signals import TurnSignals
from smarts.types.agent_states import AgentStatus
from smarts.types.mission import GoalKind
from smarts.types.vehicles import Owner, VehicleKind
from tests import maps
from tests.unit.sim.bubble_stage import AIRLOCK, DRIVEN, NONE, RELEASING, Road, gate
from tests.worlds import Car, world_of


def test_a_vehicle_goes_through_all_phases_and_back_to_traffic():
    road = Road(gate())
    slot = road.car(84.5, speed=10.0)
    road.reset().step(6)
    assert road.phase(slot) == NONE, "at 90.5: proposed, carried out in the next step"
    road.step()
    assert (road.phase(slot), road.owner(slot), road.state(slot)) == (
        AIRLOCK,
        Owner.TRAFFIC,
        AgentStatus.SHADOWING,
    )
    road.step(8)
    assert road.phase(slot) == AIRLOCK, "at 99.5"
    road.step(2)
    assert (road.phase(slot), road.owner(slot)) == (DRIVEN, Owner.AGENT), "at 101.5"
    road.step(18)
    assert road.phase(slot) == DRIVEN, "at 119.5"
    road.step()
    assert road.phase(slot) == RELEASING
    assert road.world.agents.release_step[0, road.column(slot)] == road.world.step[0]
    road.step()
    assert (road.phase(slot), road.owner(slot), road.column(slot)) == (NONE, Owner.TRAFFIC, -1)
    road.step(20)
    assert road.count("taken") == 1
    assert len(road.pool.starts[0]) == 1, "in the margin behind the zone no agent is announced again"


def test_a_vehicle_that_comes_back_is_taken_again_by_a_new_agent():
    road = Road(gate())
    slot = road.car(105)
    road.reset().step(3)
    assert road.phase(slot) == DRIVEN
    road.step(2, c0=125.0)
    road.step(3)
    assert road.column(slot) == -1
    road.step(1, c0=105.0)
    road.step(3)
    assert road.phase(slot) == NONE, "it has not left the margin"
    road.step(1, c0=140.0)
    road.step(1, c0=105.0)
    road.step(3)
    assert road.phase(slot) == DRIVEN
    assert [start.name for start in road.pool.starts[0]] == ["agent-car", "agent-car~2"]


def test_an_agent_that_has_not_acted_does_not_drive():
    road = Road(gate(), acts=False)
    slot = road.car(110)
    road.reset().step(6)
    assert road.phase(slot) == AIRLOCK
    assert road.world.agents.next_due[0, road.column(slot)] == road.world.step[0], "it is asked in every step"
    road.acts = True
    road.step(2)
    assert road.phase(slot) == DRIVEN


@pytest.mark.parametrize("period", [1, 5])
def test_the_first_action_is_asked_for_when_the_zone_is_reached_whatever_the_period(period):
    road = Road(gate(period=period))
    slot = road.car(95.5, speed=10.0)
    road.reset().step(5)
    assert road.phase(slot) == AIRLOCK
    assert road.world.agents.next_due[0, road.column(slot)] == road.world.step[0]
    road.step()
    assert road.phase(slot) == DRIVEN


def test_a_vehicle_that_turns_back_in_the_margin_is_let_go():
    road = Road(gate())
    slot = road.car(95)
    road.reset().step(3)
    assert road.phase(slot) == AIRLOCK
    road.step(1, c0=80.0)
    road.step()
    assert (road.column(slot), road.owner(slot), road.count("taken")) == (-1, Owner.TRAFFIC, 0)


def test_a_vehicle_that_comes_back_into_the_zone_is_driven_on():
    road = Road(gate())
    slot = road.car(110)
    road.reset().step(3)
    road.traffic.closed = frozenset([slot])
    road.step(2, c0=125.0)
    assert (road.phase(slot), road.state(slot)) == (RELEASING, AgentStatus.ACTIVE)
    road.step(1, c0=119.0)
    assert road.phase(slot) == DRIVEN
    assert road.world.agents.release_step[0, road.column(slot)] == -1


def test_a_shadow_of_an_agent_that_has_failed_is_let_go_and_not_observed_again():
    road = Road(gate())
    slot = road.car(95)
    road.reset().step(2)
    road.world.agents.release_step[0, road.column(slot)] = 2
    road.step(3)
    assert road.column(slot) == -1
    assert len(road.pool.starts[0]) == 1


def test_a_vehicle_that_was_never_taken_is_not_taken_behind_the_zone():
    road = Road(gate())
    slot = road.car(95, speed=10.0)
    road.reset()
    road.agents_gate.closed = frozenset([slot])
    road.step(28)
    road.agents_gate.closed = frozenset()
    road.step(5)
    assert road.phase(slot) == AIRLOCK, "in the margin behind the zone"
    road.step(10)
    assert (road.column(slot), road.count("taken")) == (-1, 0)


class TestLimits:
    def test_no_more_than_the_limit_drive_at_a_time_and_the_longest_waiting_comes_first(self):
        road = Road(gate(hijack_limit=1))
        slots = [road.car(101 + 5 * n, lane=n % 3) for n in range(3)]
        road.reset().step(6)
        assert [road.phase(slot) for slot in slots] == [DRIVEN, AIRLOCK, AIRLOCK]
        road.step(1, c0=150.0)
        road.step(3)
        assert [road.phase(slot) for slot in slots] == [NONE, DRIVEN, AIRLOCK]

    def test_one_that_cannot_be_taken_does_not_keep_the_others_out(self):
        road = Road(gate(hijack_limit=1))
        slots = [road.car(101 + 5 * n, lane=n % 3) for n in range(2)]
        road.agents_gate.closed = frozenset([slots[0]])
        road.reset().step(6)
        assert [road.phase(slot) for slot in slots] == [AIRLOCK, DRIVEN]

    def test_who_finds_the_limit_reached_is_refused_until_out_of_the_margin(self):
        road = Road(gate(hijack_limit=1, shadow_limit=1))
        slots = [road.car(105), road.car(112, lane=0)]
        road.reset().step(3)
        assert [road.phase(slot) for slot in slots] == [DRIVEN, NONE]
        assert road.count("at_limit") == 1
        road.step(1, c0=150.0)
        road.step(5)
        assert [road.phase(slot) for slot in slots] == [NONE, NONE]
        road.step(1, c1=150.0)
        road.step(1, c1=112.0)
        road.step(3)
        assert road.phase(slots[1]) == DRIVEN

    def test_a_full_pool_is_counted_and_tried_again_by_the_same_agent(self):
        road = Road(gate(), columns=1)
        slots = [road.car(105), road.car(112, lane=0)]
        road.reset().step(6)
        assert [road.phase(slot) for slot in slots] == [DRIVEN, NONE]
        assert (road.count("without_column"), len(road.pool.starts[0])) == (1, 2)
        road.step(1, c0=150.0)
        road.step(4)
        assert road.phase(slots[1]) == DRIVEN
        assert len(road.pool.starts[0]) == 2

    def test_random_traffic_keeps_all_limits(self):
        random = np.random.default_rng(3)
        road = Road(gate(hijack_limit=2, shadow_limit=3), gate(zone=box(110, -30, 150, 30), shadow_limit=2))
        for number in range(12):
            road.car(random.uniform(60, 160), lane=number % 3, speed=random.uniform(-15, 15))
        road.reset()
        holds = road.rules._field.holds
        for _ in range(150):
            road.step()
            turned = random.random(24) < 0.05
            road.world.vehicles.speed[0] *= np.where(turned, -1, 1)
            road.agents_gate.closed = frozenset(np.flatnonzero(random.random(24) < 0.3).tolist())
            road.traffic.closed = frozenset(np.flatnonzero(random.random(24) < 0.6).tolist())
            phase, number = holds.phase[0], holds.bubble[0]
            driven = np.isin(phase, (DRIVEN, RELEASING))
            assert np.count_nonzero(driven & (number == 0)) <= 2
            assert np.count_nonzero(number == 0) <= 3
            assert np.count_nonzero(number == 1) <= 2
            held = road.world.agents.slot[0][road.world.agents.slot[0] >= 0].tolist()
            assert len(held) == len(set(held))
        assert road.count("taken") > 5


class TestAdmission:
    def test_the_first_bubble_of_the_file_wins_and_the_second_takes_what_it_refuses(self):
        first = gate(id="first", actor="one", spared=("bus",))
        second = gate(id="second", actor="two")
        road = Road(first, second)
        car, bus = road.car(105, name="car"), road.car(112, lane=0, name="bus")
        road.reset().step(3)
        names = {road.column(slot): road.pool.name(0, road.column(slot)) for slot in (car, bus)}
        assert sorted(names.values()) == ["one-car", "two-bus"]

    def test_kinds_that_agents_cannot_drive_are_left_alone_and_counted(self):
        road = Road(gate())
        slot = road.car(105, kind=VehicleKind.TRAILER)
        road.reset().step(5)
        assert (road.column(slot), road.count("not_drivable")) == (-1, 1)
        assert not road.pool.starts[0]

    def test_vehicles_of_agents_are_left_alone(self):
        road = Road(gate())
        slot = road.car(105)
        road.world.vehicles.owner[0, slot] = Owner.AGENT
        road.reset().step(3)
        assert not road.pool.starts[0]


class TestLearners:
    def test_they_are_told_that_they_have_left(self):
        road = Road(gate(policy=-1), acts=False)
        slot = road.car(105)
        road.reset().step(3)
        column = road.column(slot)
        assert (road.phase(slot), bool(road.rules.left.any())) == (DRIVEN, False)
        road.step(1, c0=125.0)
        assert road.rules.left[0].tolist() == [a == column for a in range(4)]
        assert road.world.agents.release_step[0, column] == -1, "the events end the agent"


def test_the_mission_is_the_vehicles_own_route_to_its_end():
    road = Road(gate())
    slot = road.car(105)
    road.reset().step(1)
    mission = road.pool.starts[0][0].mission
    assert (mission.route, mission.goal) == (("road",), GoalKind.OFF_MAP)
    assert mission.route_length == pytest.approx(400 - 103)
    assert road.pool.starts[0][0].collision_time == 5.0
    assert road.column(slot) >= 0


@pytest.mark.parametrize("place", [0, 2, 5])
def test_the_mission_of_a_vehicle_whose_route_comes_by_several_times_is_the_rest(place):
    graph = maps.graph_of(
        {
            "side": maps.Road([(0, 0), (100, 0)]),
            "round": maps.Road([(110, 10), (110, 60), (-10, 60), (-10, 10)]),
            "out": maps.Road([(110, -10), (110, -60)]),
        },
        [(("side", 0), ("round", 0)), (("round", 0), ("side", 0)), (("side", 0), ("out", 0))],
    )
    made = world_of([Car(40.0, 0.0)], maps=[graph])
    route = ("side", "round", "side", "round", "side", "out")
    vehicles = made.world.vehicles
    vehicles.route[0, 0] = made.world.routes.number(0, map(graph.edge_number, route))
    signals = TurnSignals(Scene(made.world, made.atlas, made.routes))
    poses = {"side": (40.0, 0.0, 0.0), "round": (50.0, 60.0, math.pi), "out": (110.0, -30.0, -math.pi / 2)}
    for edge in route[: place + 1]:
        *vehicles.position[0, 0], vehicles.heading[0, 0] = poses[edge]
        made.match()
        signals.show(np.ones(1, np.bool_))
        made.world.step += 1
    mission = HoldMissions(made.world, made.routes).mission(0, 0)
    assert mission.route == (route[place:] if route[place] in route[:place] else route)
    length = corridor_of(graph, route[place:]).length - vehicles.lane_position[0, 0]
    assert mission.route_length == pytest.approx(length)


def test_a_collision_is_counted_once():
    road = Road(gate())
    slot = road.car(105)
    road.reset().step(3)
    road.world.agents.harmed[0, road.column(slot)] = True
    road.step(3)
    assert road.count("collided") == 1
