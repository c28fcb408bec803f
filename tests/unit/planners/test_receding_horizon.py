"""The receding-horizon planner against the model's closed forms, and its promises."""

import math

import casadi as ca
import numpy as np
import pytest

from smarts.geometry.boxes import box_gaps
from smarts.geometry.frames import wrap_angle
from smarts.planners import Limits, Neighbours, PlanStatus, RecedingHorizonPlanner
from smarts.planners.optimal_control import _driven, _gaps
from smarts.types.streams import Purpose, stream

CAR = Limits()
SIZE = np.array([5.0, 2.0])
"""Size of all vehicles [m]."""


@pytest.fixture(scope="module")
def planner():
    return RecedingHorizonPlanner(CAR)


def neighbours(*rows):
    """Return neighbours of one vehicle at constant velocity: x, y, heading, speed each."""
    path = np.array([[0.0, *row] for row in rows])
    return Neighbours(path[None, :, None], np.tile(SIZE, (1, len(rows), 1)))


def plan(planner, state, target, *rest):
    plans = planner.plan(np.array([state], float), np.array([target], float), *rest)
    assert plans.status[0] == PlanStatus.PLANNED
    return plans.path[0]


def test_the_model_drives_circles():
    steering = 0.3
    slip = math.atan(0.5 * math.tan(steering))
    radius = CAR.wheelbase / (2 * math.sin(slip))
    state = np.array([0, 0, -slip, 8.0, steering])
    for _ in range(20):
        state = np.array(_driven(ca.DM(state), ca.DM([0, 0]), 0.2, CAR.wheelbase)).ravel()
    angle = 8.0 * 4.0 / radius
    expected = [radius * math.sin(angle), radius * (1 - math.cos(angle)), angle - slip, 8.0, steering]
    np.testing.assert_allclose(state, expected, atol=1e-3)
    assert 1 / radius < CAR.sharpest


def test_gaps_are_those_of_the_geometry():
    draw = stream(0, Purpose.AGENTS)
    for _ in range(50):
        pose, other = (draw.uniform([-6, -6, -math.pi], [6, 6, math.pi]) for _ in range(2))
        found = float(_gaps(ca.DM(pose), CAR, ca.DM(other), ca.DM(SIZE))[0])
        expected = box_gaps(tuple(pose), 2.5, 1.0, tuple(other), 2.5, 1.0)
        assert found == pytest.approx(max(expected), abs=1e-12)


def test_a_quarter_circle_keeps_its_curvature(planner):
    radius, speed = 20.0, 6.0
    target = [0.5 * math.pi * radius / speed, radius, radius, math.pi / 2, speed]
    path = plan(planner, [0, 0, 0, speed, 1 / radius], target)
    assert np.abs(np.hypot(path[:, 1], path[:, 2] - radius) - radius).max() < 0.5
    np.testing.assert_allclose(path[-1, 1:3], target[1:3], atol=0.3)


def test_paths_do_not_depend_on_place_and_direction(planner):
    here = plan(planner, [0, 0, 0, 8, 0], [5, 35, 6, 0.5, 8], neighbours([20, 0, 0, 3]))
    turn = np.array([[0.0, 1.0], [-1.0, 0.0]])
    state = [1000, -2000, math.pi / 2, 8, 0]
    target = [5, *(np.array([35, 6]) @ turn + state[:2]), 0.5 + math.pi / 2, 8]
    around = neighbours([*(np.array([20, 0]) @ turn + state[:2]), math.pi / 2, 3])
    there = plan(planner, state, target, around)
    np.testing.assert_allclose(there[:, 1:3], here[:, 1:3] @ turn + state[:2], atol=1e-2)
    np.testing.assert_allclose(wrap_angle(there[:, 3] - here[:, 3]), math.pi / 2, atol=1e-2)


def test_limits_hold():
    slow = Limits(speed=9.0, acceleration=1.0, braking=2.0)
    path = plan(RecedingHorizonPlanner(slow), [0, 0, 0, 5, 0], [2, 60, 4, 0, 15])
    changes = np.diff(path[:, 4]) / np.diff(path[:, 0])
    assert path[:, 4].max() <= 9.0 + 1e-3
    assert changes.max() <= 1.0 + 1e-6
    assert changes.min() >= -2.0 - 1e-6
    assert path[-1, 0] == pytest.approx(6.0)  # the horizon is 6 s at most


def test_it_stops_behind_a_vehicle_that_stands_across_the_way(planner):
    # A wall of standing vehicles at 30 m: the front is to stay 0.5 m before it.
    wall = neighbours([30, 0, math.pi / 2, 0], [30, 5, math.pi / 2, 0], [30, -5, math.pi / 2, 0])
    path = plan(planner, [0, 0, 0, 8, 0], [5, 40, 0, 0, 8], wall)
    assert 20.0 < path[-1, 1] <= 30 - 1.0 - 2.5 - 0.4
    assert np.abs(path[:, 2]).max() < 3.0


def test_equal_calls_give_equal_bits_and_rows_are_independent(planner):
    draw = stream(5, Purpose.AGENTS)
    states, targets = np.tile([0.0, 0, 0, 8, 0], (8, 1)), np.tile([6.0, 48, 0, 0, 8], (8, 1))
    targets[:, 2] = draw.uniform(-4.0, 4.0, 8)
    rows = draw.uniform([10, -8, -0.2, 2], [60, 8, 0.2, 9], (8, 3, 4))
    paths = np.concatenate([np.zeros((8, 3, 1)), rows], axis=2)[:, :, None]
    around = Neighbours(paths, np.tile(SIZE, (8, 3, 1)))
    states[3] = np.nan
    both = planner.plan(states, targets, around)
    again = RecedingHorizonPlanner(CAR).plan(states, targets, around, both.path, 0.1)
    assert again.path.tobytes() == planner.plan(states, targets, around, both.path, 0.1).path.tobytes()
    assert both.status[3] == PlanStatus.FAILED
    for n in range(8):
        one = Neighbours(around.path[n : n + 1], around.size[n : n + 1])
        alone = planner.plan(states[n : n + 1], targets[n : n + 1], one)
        assert alone.path.tobytes() == both.path[n : n + 1].tobytes()


def test_the_last_path_is_driven_on_when_planning_fails(planner):
    last = planner.plan(np.array([[0, 0, 0, 8.0, 0]]), np.array([[4, 32, 3, 0, 8.0]])).path
    lost = np.array([[np.inf, 0, 0, 8.0, 0]])
    kept = planner.plan(lost, np.array([[3, 32, 3, 0, 8.0]]), None, last, 1.0)
    assert kept.status[0] == PlanStatus.SHIFTED
    assert kept.path[0, 0, 0] == 0.0
    np.testing.assert_allclose(kept.path[0, -1], [3.0, *last[0, -1, 1:]], atol=1e-9)
    over = planner.plan(lost, np.array([[3, 32, 3, 0, 8.0]]), None, kept.path, 3.0)
    assert over.status[0] == PlanStatus.FAILED
    assert np.isnan(over.path).all()
