"""What models of drivers see, against distances worked out by hand."""

import math

import numpy as np
import pytest

from smarts.observations.arrays import ArrayObservation
from smarts.observations.surroundings import LANE_TRAFFIC, LEFT, OWN, OWN_VEHICLE, RIGHT, Lane, Own
from smarts.types.agent_states import ChangePhase
from smarts.types.mission import AgentMission, GoalKind
from smarts.types.traffic import Signal
from smarts.types.vehicles import Owner, VehicleKind
from tests.maps import crossing, straight
from tests.unit.observations.test_features import context_of
from tests.worlds import Car, world_of


def mission(*route, goal=(190.0, 0.0)):
    return AgentMission(route=route, goal=GoalKind.POSITION, goal_position=goal, goal_radius=2.0)


def look(made, change=False):
    if change:
        made.world.agents.change_phase[:] = ChangePhase.MOVING
    observation = ArrayObservation(context_of(made), ["surroundings"])
    seen = observation.observe(np.ones((made.world.worlds, 1), bool))
    return seen[OWN_VEHICLE][0, 0], seen[LANE_TRAFFIC][0, 0]


def width():
    graph = straight()
    return graph.width[0]


def test_an_empty_road():
    own, lanes = look(world_of([Car(50.0, width(), 0.1, 7.0, mission("road"))], maps=[straight()]))
    assert own[[Own.X, Own.SPEED, Own.LENGTH, Own.WIDTH]].tolist() == [50.0, 7.0, 5.0, 1.8]
    assert own[[Own.HEADING, Own.TURN]] == pytest.approx([0.1, 0.1])
    assert own[Own.OFFSET] == pytest.approx(0.0, abs=1e-9)
    assert np.isinf(own[[Own.LIGHT_GAP, Own.YIELD_GAP]]).all()
    assert lanes[:, Lane.OPEN].tolist() == [1.0, 1.0, 1.0]
    assert np.isinf(lanes[:, [Lane.AHEAD, Lane.BEHIND, Lane.LEFT, Lane.END]]).all()
    assert lanes[:, Lane.ALLOWED] == pytest.approx(straight().speed_limit[0])


def test_gaps_are_from_bumper_to_bumper():
    w = width()
    cars = [
        Car(60.0, w, 0.0, 7.0, mission("road")),
        Car(80.0, w, 0.0, 5.0, length=12.0, name="ahead"),
        Car(120.0, w, 0.0, 1.0, name="farther"),
        Car(40.0, w, 0.0, 9.0, name="behind"),
        Car(70.0, 2 * w, 0.0, 3.0, name="left ahead"),
        Car(57.0, 0.0, 0.0, 4.0, name="right, beside"),
    ]
    _, lanes = look(world_of(cars, maps=[straight()]))
    assert lanes[OWN, [Lane.AHEAD, Lane.AHEAD_SPEED]] == pytest.approx([20.0 - 8.5, 5.0])
    assert lanes[OWN, [Lane.BEHIND, Lane.BEHIND_SPEED]] == pytest.approx([15.0, 9.0])
    assert lanes[LEFT, [Lane.AHEAD, Lane.AHEAD_SPEED]] == pytest.approx([5.0, 3.0])
    assert np.isinf(lanes[LEFT, Lane.BEHIND])
    assert lanes[RIGHT, [Lane.BEHIND, Lane.BEHIND_SPEED]] == pytest.approx([-2.0, 4.0])
    assert np.isinf(lanes[RIGHT, Lane.AHEAD])


def test_a_vehicle_between_two_lanes_is_in_both():
    w = width()
    cars = [Car(60.0, w, mission=mission("road")), Car(80.0, 1.5 * w, name="between", width=2.4)]
    _, lanes = look(world_of(cars, maps=[straight()]))
    assert lanes[[OWN, LEFT], Lane.AHEAD] == pytest.approx([15.0, 15.0])
    assert np.isinf(lanes[RIGHT, Lane.AHEAD])


@pytest.mark.parametrize(
    ("kind", "length", "y", "gap"),
    [
        (VehicleKind.PASSENGER, 5.0, -20.0, np.inf),
        (VehicleKind.BUS, 12.0, -20.0, 20.0 - 6.0 - 2.5),
        (VehicleKind.BUS, 12.0, -35.0, np.inf),
    ],
)
def test_a_long_vehicle_needs_the_lane_beside_before_a_turn(kind, length, y, gap):
    """The turn begins at y = -10; a vehicle that stands 2.9 m to the left is in the way from 16 m before."""
    right = AgentMission(route=("south_in", "east_out"), goal=GoalKind.POSITION, goal_position=(80.0, -1.6))
    own = Car(1.6, -40.0, math.pi / 2, 5.0, right, kind=kind, length=length, width=1.8)
    made = world_of([own, Car(-1.3, y, math.pi / 2, 0.0)], maps=[crossing()])
    assert look(made)[1][OWN, Lane.AHEAD] == pytest.approx(gap)


def test_during_a_change_both_lanes_count():
    w = width()
    made = world_of(
        [Car(60.0, w, mission=mission("road")), Car(80.0, w, name="left behind")], maps=[straight()]
    )
    made.world.agents.target_lane[0, 0] = 2
    own, lanes = look(made, change=True)
    assert own[Own.CHANGING] == 1.0
    assert lanes[OWN, Lane.AHEAD] == pytest.approx(15.0)
    _, lanes = look(made)
    assert lanes[LEFT, Lane.OPEN] == 0.0
    assert lanes[RIGHT, Lane.AHEAD] == pytest.approx(15.0)


SOUTH = AgentMission(route=("south_in", "north_out"), goal=GoalKind.POSITION, goal_position=(1.6, 80.0))
"""Straight on; the line is at y = -10."""


def wait_for(*cars, own_speed=8.0, own_y=-30.0, signals=()):
    """Return what a vehicle sees that comes from the south and gives way to the west."""
    graph = crossing(gives_way={("south", "north"): [("west", "east")]})
    made = world_of([Car(1.6, own_y, math.pi / 2, own_speed, SOUTH), *cars], maps=[graph])
    for lane, light in signals:
        made.world.signals[0, graph.lane_ids.index(lane)] = light
    return look(made)[0]


def crossing_lane(begin, end):
    """Return the name of a lane inside the junction, in the order in which `crossing` makes them."""
    arms = ("west", "south", "east", "north")
    pairs = [(a, b) for a in arms for b in arms if a != b]
    return f":junction_{pairs.index((begin, end))}_0"


@pytest.mark.parametrize("light", [Signal.STOP, Signal.CAUTION])
def test_lights_that_stop(light):
    own = wait_for(signals=[(crossing_lane("south", "north"), light)])
    assert own[[Own.LIGHT, Own.LIGHT_GAP]] == pytest.approx([light, 17.5])


def test_a_road_that_ends():
    """Traffic leaves there; an agent's own vehicle sees the end, unless its goal is before it."""
    for goal, gap in (((190.0, 0.0), np.inf), ((10.0, 0.0), 200.0 - 150.0 - 2.5)):
        made = world_of([Car(150.0, width(), 0.0, 7.0, mission("road", goal=goal))], maps=[straight()])
        made.world.agents.on_route[0, 0] &= np.isinf(gap)
        assert look(made)[1][OWN, Lane.END] == pytest.approx(gap)
        made.world.vehicles.home[0, 0] = Owner.TRAFFIC
        assert look(made)[1][OWN, Lane.END] == np.inf


def test_a_leader_beyond_the_junction():
    made = world_of(
        [Car(1.6, -30.0, math.pi / 2, 8.0, SOUTH), Car(1.6, 30.0, math.pi / 2, 4.0)], maps=[crossing()]
    )
    _, lanes = look(made)
    assert lanes[OWN, [Lane.AHEAD, Lane.AHEAD_SPEED]] == pytest.approx([55.0, 4.0], abs=1e-6)
    assert lanes[OWN, Lane.ALLOWED] == pytest.approx(math.sqrt(10.0**2 + 2 * 1.5 * 20.0))
