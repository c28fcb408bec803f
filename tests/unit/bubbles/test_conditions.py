"""The facts that conditions of bubbles get."""

import pytest

from smarts.bubbles.conditions import ConditionRunner
from smarts.sstudio import sstypes as t
from smarts.types.vehicles import VehicleKind
from tests import maps
from tests.worlds import Car, world_of

ROADS = maps.straight()


class Everything:
    """Keeps the facts that it is given."""

    requires = (
        t.ConditionRequires.time
        | t.ConditionRequires.actor_ids
        | t.ConditionRequires.current_actor_state
        | t.ConditionRequires.current_actor_road_status
    )

    def evaluate(self, *, memory=None, **facts):
        self.memory, self.facts = memory, facts
        return t.ConditionState.TRUE


@pytest.fixture
def made():
    cars = [
        Car(50, 0, 0.5, speed=7.0, kind=VehicleKind.BUS, name="bus"),
        Car(80, 30, name="lost"),
        Car(90, 0, name="car"),
    ]
    made = world_of(cars, cars, maps=[ROADS])
    made.world.step[:] = 25
    return made


def test_the_facts_about_a_vehicle(made):
    condition = Everything()
    assert ConditionRunner(made.world).admits(0, 0, 0, condition, ROADS)
    facts = condition.facts
    assert (facts["time"], facts["actor_ids"]) == (2.5, {"bus", "lost", "car"})
    state = facts["current_actor_state"]
    assert (state.actor_id, state.vehicle_config_type, state.speed) == ("bus", "bus", 7.0)
    assert (state.position, state.heading) == ((50.0, 0.0), 0.5)
    assert (facts["current_actor_road_status"].road, facts["current_actor_road_status"].off_road) == (
        "road",
        False,
    )


def test_a_vehicle_beside_all_lanes(made):
    condition = Everything()
    ConditionRunner(made.world).admits(0, 0, 1, condition, ROADS)
    status = condition.facts["current_actor_road_status"]
    assert (status.road, status.off_road) == (None, True)


def test_only_the_facts_that_are_needed_are_given(made):
    condition = Everything()
    condition.requires = t.ConditionRequires.time
    assert ConditionRunner(made.world).is_active(0, 0, condition)
    assert set(condition.facts) == {"time"}
    assert ConditionRunner(made.world).admits(0, 0, 0, condition, ROADS)
    assert set(condition.facts) == {"time"}


def test_clocks_are_apart_by_simulation_bubble_and_vehicle(made):
    runner, condition = ConditionRunner(made.world), t.TimeWindowCondition(0, 9).trigger(1.0)
    for row in range(2):
        assert not runner.is_active(row, 0, condition)
    made.world.step[0] += 10
    assert [runner.is_active(row, 0, condition) for row in range(2)] == [True, False]
    assert not runner.is_active(0, 1, condition)
    assert not runner.admits(0, 0, 0, condition, ROADS)
    made.world.step[0] += 10
    assert runner.admits(0, 0, 0, condition, ROADS)
    assert runner.admits(0, 0, 2, condition, ROADS) == t.ConditionState.BEFORE
    made.world.vehicles.generation[0, 0] += 1
    assert runner.admits(0, 0, 0, condition, ROADS) == t.ConditionState.BEFORE
    runner.clear(0)
    assert not runner.is_active(0, 0, condition)
