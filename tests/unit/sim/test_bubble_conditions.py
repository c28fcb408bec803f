"""Bubbles with conditions, and bubbles that travel, computed by hand; zones as in `test_bubble_rules`."""

import math

import pytest
from shapely.geometry import box

from smarts.sstudio import sstypes as t
from smarts.types.vehicles import Owner, VehicleKind
from tests.unit.sim.bubble_stage import AIRLOCK, DRIVEN, NONE, RELEASING, Road, gate


class TestConditions:
    def test_a_time_window(self):
        window = t.TimeWindowCondition(0.5, 1.5)
        road = Road(gate(active_condition=window))
        slot = road.car(105)
        road.reset().step(4)
        assert road.phase(slot) == NONE
        road.step(3)
        assert road.phase(slot) == DRIVEN
        road.step(7)
        assert road.phase(slot) == DRIVEN
        road.step()
        assert road.phase(slot) == RELEASING, "at 1.5 s"
        road.step(10)
        assert road.phase(slot) == NONE

    def test_a_type_and_a_speed_are_asked_for_once(self):
        slow = t.VehicleSpeedCondition(0.0, 5.0) & t.VehicleTypeCondition("passenger")
        road = Road(gate(airlock_condition=slow))
        fast, standing = road.car(85, speed=10.0), road.car(105, lane=0)
        bus = road.car(110, lane=2, kind=VehicleKind.BUS)
        road.reset().step(8)
        assert [road.phase(slot) for slot in (fast, standing, bus)] == [NONE, DRIVEN, NONE]
        road.world.vehicles.speed[0, fast] = 0.0
        road.step(4)
        assert road.phase(fast) == NONE, "the refusal holds in the margin"

    def test_a_trigger_is_asked_again_while_it_waits_and_each_vehicle_has_its_own_clock(self):
        """The clock starts when the vehicle slows down in the margin, for each vehicle apart."""
        loiters = t.VehicleSpeedCondition(0.0, 5.0).trigger(0.5)
        road = Road(gate(airlock_condition=loiters))
        first, second = road.car(95), road.car(98, lane=0, speed=-8.0)
        road.reset().step(5)
        assert (road.phase(first), road.phase(second)) == (NONE, NONE)
        road.step()
        assert (road.phase(first), road.phase(second)) == (AIRLOCK, NONE)

    def test_off_road(self):
        road = Road(gate(airlock_condition=-t.OffRoadCondition()))
        on, off = road.car(105), road.car(110)
        road.world.vehicles.position[0, off, 1] += 20.0
        road.reset().step(3)
        assert (road.phase(on), road.phase(off)) == (DRIVEN, NONE)


class TestMovingBubbles:
    def moving(self, **more):
        ahead = {"followed": "leader", "follow_offset": (0.0, 20.0)}
        return gate(2.0, box(-5, -30, 5, 30), **(ahead | more))

    def test_a_bubble_travels_with_a_vehicle_and_lets_go_what_it_leaves_behind(self):
        """It is 20 m ahead of the leader's centre, whose front is 2 m ahead; the zone turned is 60 m long."""
        road = Road(self.moving())
        leader, standing = road.car(22, speed=10.0, name="leader"), road.car(100, lane=0)
        road.reset()
        assert road.rules.states.pose[0, 0].tolist() == pytest.approx(
            [40.0, 0.0 + _y(road, leader), -math.pi / 2]
        )
        road.step(28)
        assert road.phase(standing) == NONE, "the zone's front is at 98 m, its margin's at 100 m"
        road.step(2)
        assert road.phase(standing) == AIRLOCK
        road.step(2)
        assert road.phase(standing) == DRIVEN
        road.step(60)
        assert road.column(standing) == -1
        assert road.owner(standing) == Owner.TRAFFIC
        assert road.column(leader) == -1, "the bubble never takes the vehicle that it follows"

    def test_a_vehicle_that_never_appears_is_counted_and_nothing_is_taken(self):
        road = Road(self.moving(), self.moving(followed="other"))
        slot = road.car(60)
        road.reset().step(5)
        assert (road.count("never_appeared"), road.phase(slot)) == (2, NONE)
        assert not road.rules.states.is_active.any()
        road.car(42, lane=0, name="leader")
        road.step(4)
        assert (road.count("never_appeared"), road.phase(slot)) == (1, DRIVEN)

    def test_all_are_let_go_when_the_followed_vehicle_is_gone(self):
        road = Road(self.moving())
        leader, slot = road.car(42, lane=0, name="leader"), road.car(60)
        road.reset().step(3)
        assert road.phase(slot) == DRIVEN
        road.world.registry.dismiss(0, leader)
        road.step()
        assert (road.phase(slot), bool(road.rules.states.is_active[0, 0])) == (RELEASING, False)
        road.step()
        assert road.column(slot) == -1
        assert road.count("never_appeared") == 0

    def test_it_follows_an_agent_by_its_name_whatever_its_vehicle_is_called(self):
        road = Road(gate(zone=box(100, -30, 110, 30), actor="driver"), self.moving(followed="driver-car"))
        led, slot = road.car(105), road.car(125, lane=0)
        road.reset().step(5)
        assert (road.phase(led), road.phase(slot)) == (DRIVEN, DRIVEN)
        road.step(1, c0=200.0)
        road.step(3)
        assert (road.column(led), road.column(slot)) == (-1, -1)


def _y(road, slot):
    return float(road.world.vehicles.position[0, slot, 1])
