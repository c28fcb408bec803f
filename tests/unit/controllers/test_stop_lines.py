"""How the fallback controller waits at junctions and stops at lights: its reference's speeds, by hand."""

import math

import numpy as np
import pytest

from smarts.controllers.leaders import limit_by_leaders
from smarts.controllers.stop_lines import limit_by_lights, limit_by_right_of_way
from smarts.dynamics.performance import performance
from smarts.geometry.binding import bind
from smarts.types.mission import AgentMission, GoalKind
from smarts.types.traffic import Signal
from tests.maps import crossing
from tests.worlds import Car, place_on_route, world_of

NORTH = AgentMission(route=("south_in", "north_out"), goal=GoalKind.POSITION, goal_position=(1.6, 80.0))


def driving(y, speed, *others):
    """Return a world with a car on its way north, the car's slot and place on its route, and its reference.

    The points of the reference are 1 m apart, from the middle of the car.
    """
    made = world_of([Car(1.6, y, math.pi / 2, speed, NORTH), *others], maps=[crossing()])
    points = np.zeros((30, 4))
    points[:, 0], points[:, 1] = 1.6, y + np.arange(30)
    points[:, 2], points[:, 3] = math.pi / 2, 10.0
    return made, *place_on_route(made), points


def speeds(y, speed, other):
    """Return the speeds of a reference that right of way limits."""
    made, slot, row, place, points = driving(y, speed, other)
    held = made.world.state, made.atlas.roads, made.routes.current, performance(made.atlas)
    bind(limit_by_right_of_way, *held)(0, slot, row, place, points)
    return points[:, 3]


def speeds_at_light(y, speed, towards, signal):
    """Return the speeds of a reference that lights limit; only the way to `towards` shows this one."""
    made, slot, row, place, points = driving(y, speed)
    graph = made.atlas.graphs[0]
    for lane in range(len(graph.lane_ids)):
        if graph.is_internal[lane]:
            leads_to = {graph.lane_ids[each].rpartition("_")[0] for each in graph.successors(lane)}
            made.world.signals[0, lane] = signal if towards in leads_to else Signal.GO
    bind(limit_by_lights, made.world.state, made.atlas.roads, made.routes.current)(
        0, slot, row, place, points
    )
    return points[:, 3]


@pytest.mark.parametrize(("y", "speed"), [(-6.4, 0.4), (-6.4, 0.0)])
def test_a_vehicle_that_has_come_to_where_it_waits_does_not_creep_on(y, speed):
    """Its front is 0.7 m or less before the lane of a car that stands in its way."""
    assert (speeds(y, speed, Car(1.6, -1.6, 0.0, 0.0)) == 0.0).all()


def test_a_vehicle_stops_before_a_red_light():
    """Its line is 2.5 m ahead of it, where it would brake with 3 m/s^2 over 1.5 m to stop 1 m before."""
    found = speeds_at_light(-15.0, 2.0, "north_out", Signal.STOP)
    assert found[0] == pytest.approx(math.sqrt(2.0 * 3.0 * 1.5))
    assert (found[2:] == 0.0).all()


@pytest.mark.parametrize(
    ("towards", "signal"),
    [("north_out", Signal.NONE), ("north_out", Signal.CAUTION), ("east_out", Signal.STOP)],
)
def test_a_vehicle_stops_at_no_other_light(towards, signal):
    assert (speeds_at_light(-15.0, 2.0, towards, signal) == 10.0).all()


def test_a_vehicle_that_would_have_to_brake_harder_than_it_may_drives_on():
    """Over 2.5 m, 6 m/s^2 stop 5.5 m/s."""
    assert (speeds_at_light(-15.0, 5.6, "north_out", Signal.STOP) == 10.0).all()
    assert speeds_at_light(-15.0, 5.4, "north_out", Signal.STOP)[-1] == 0.0


def test_a_leader_on_a_path_that_leads_round_counts():
    """On a circle with a radius of 20 m, 25 m ahead: the gap is 20 m, of which 2.5 m are left behind it."""
    angles = np.arange(60) / 30.0 * math.pi
    points = np.column_stack(
        [20.0 * np.sin(angles), 20.0 - 20.0 * np.cos(angles), angles, 0.0 * angles + 10.0]
    )
    leader = Car(20.0 * math.sin(1.25), 20.0 - 20.0 * math.cos(1.25), 1.25)
    made = world_of([Car(0.0, 0.0, 0.0, 10.0, NORTH), leader], maps=[crossing()])
    bind(limit_by_leaders, made.world.state)(0, 0, points)
    assert points[0, 3] == 10.0
    assert points[5, 3] == pytest.approx(
        math.sqrt(2.0 * 3.0 * (20.0 - 2.5 - 5.0 * 2.0 * math.pi / 3.0)), rel=0.01
    )
    assert (points[9:, 3] == 0.0).all()


@pytest.mark.parametrize("radius", [4.0, 5.0, 10.0])
def test_a_leader_on_a_small_roundabout_is_not_a_round_farther_on(radius):
    """The reference leads round more than once; its points of a later round may be nearer to the leader."""
    stations = np.concatenate([np.arange(33.0), 32.0 + np.cumsum(1.06 ** np.arange(1, 32))])
    angles = stations / radius
    x, y = radius * np.sin(angles), radius - radius * np.cos(angles)
    made = world_of([Car(0.0, 0.0, 0.0, 5.0, NORTH), Car(0.0, 0.0)], maps=[crossing()])
    vehicles = made.world.vehicles
    for ahead in np.arange(7.0, min(2.0 * math.pi * radius - 6.0, 40.0), 0.2):
        points = np.column_stack([x, y, angles, np.full(len(angles), 5.0)])
        there = ahead / radius
        vehicles.position[0, 1] = radius * math.sin(there), radius - radius * math.cos(there)
        vehicles.heading[0, 1] = there
        bind(limit_by_leaders, made.world.state)(0, 0, points)
        assert (points[stations > ahead, 3] == 0.0).all(), ahead


@pytest.mark.parametrize(("radius", "place"), [(1.6, 15.0), (2.4, 5.0), (3.5, 24.0)])
def test_a_leader_behind_a_u_turn_counts(radius, place):
    """It stands on the opposite lane, beside the first part of the reference, which passes it at speed."""
    out, turn = np.arange(0.0, 30.0), np.arange(0.0, math.pi, 0.5 / radius)
    x = np.concatenate([out, 30.0 + radius * np.sin(turn), 30.0 - out])
    y = np.concatenate([0.0 * out, radius - radius * np.cos(turn), 0.0 * out + 2.0 * radius])
    heading = np.concatenate([0.0 * out, turn, 0.0 * out + math.pi])
    points = np.column_stack([x, y, heading, np.full(len(x), 8.0)])
    leader = Car(place, 2.0 * radius, math.pi)
    made = world_of([Car(0.0, 0.0, 0.0, 8.0, NORTH), leader], maps=[crossing()])
    bind(limit_by_leaders, made.world.state)(0, 0, points)
    is_back = y == 2.0 * radius
    assert (points[: len(out) - 10, 3] == 8.0).all()
    assert (points[is_back & (x <= place), 3] == 0.0).all()
