"""The Bezier planner against closed forms."""

import math

import numpy as np
import pytest

from smarts.planners import BezierPlanner, Limits, PlanStatus

STILL = [0.0, 0.0, 0.0, 0.0, 0.0]


def plan(state, target, limits=None, **options):
    plans = BezierPlanner(limits, **options).plan(np.array([state], float), np.array([target], float))
    assert plans.status[0] == PlanStatus.PLANNED
    return plans.path[0]


def test_even_drive_on_a_straight_line():
    path = plan([3, 4, math.pi / 2, 10, 0], [4, 3, 44, math.pi / 2, 10])
    times = np.linspace(0, 4, 32)
    expected = np.column_stack(
        [times, np.full(32, 3), 4 + 10 * times, np.full(32, math.pi / 2), np.full(32, 10)]
    )
    np.testing.assert_allclose(path, expected, atol=1e-6)


def test_from_rest_to_rest_in_a_given_time():
    # Accelerate at a to v, cruise, brake at b: d = v T - v^2 (1 / a + 1 / b) / 2.
    limits, way, duration = Limits(acceleration=2.0, braking=4.0), 60.0, 14.0
    square = 0.5 * (1 / 2.0 + 1 / 4.0)
    cruise = (duration - math.sqrt(duration**2 - 4 * square * way)) / (2 * square)
    path = plan(STILL, [duration, way, 0, 0, 0], limits)
    assert path[-1] == pytest.approx([duration, way, 0, 0, 0], abs=1e-4)
    assert path[:, 4].max() == pytest.approx(cruise, rel=0.01)


def test_the_soonest_arrival_where_the_time_is_too_short():
    # From rest at 2 m/s^2: 64 m in 8 s.
    path = plan(STILL, [1.0, 64, 0, 0, 20], Limits(acceleration=2.0))
    assert path[-1] == pytest.approx([8, 64, 0, 0, 16], rel=1e-6, abs=1e-9)
    np.testing.assert_allclose(path[:, 1], path[:, 0] ** 2, atol=1e-6)


def test_a_quarter_circle_at_the_speed_of_its_lateral_acceleration():
    radius, lateral = 20.0, 3.0
    path = plan([0, 0, 0, 7, 0], [0.5, radius, radius, math.pi / 2, 7], Limits(lateral=lateral))
    off = np.hypot(path[:, 1], path[:, 2] - radius) - radius
    assert np.abs(off).max() < 0.01  # a cubic is 0.03% off a quarter circle
    assert path[1:-1, 4].max() == pytest.approx(math.sqrt(lateral * radius), rel=0.02)
    np.testing.assert_allclose(path[:, 3], np.arctan2(path[:, 1], radius - path[:, 2]), atol=0.01)


def test_speed_stays_below_the_limits_between_all_rows():
    limits = Limits()
    path = plan([0, 0, 0, 8, 0], [6, 25, 15, math.pi / 2, 6], limits, points=200)
    way = np.hypot(*np.diff(path[:, 1:3], axis=0).T)
    bends = np.abs(np.diff(np.unwrap(path[:, 3]))) / way
    speeds = 0.5 * (path[1:, 4] + path[:-1, 4])
    changes = np.diff(path[:, 4]) / np.diff(path[:, 0])
    assert (speeds**2 * bends).max() < 1.1 * limits.lateral
    assert changes.max() < 1.01 * limits.acceleration
    assert changes.min() > -1.01 * limits.braking


def test_a_curve_that_is_too_sharp_fails_and_the_last_path_goes_on():
    planner, state = BezierPlanner(), np.array([[0, 0, 0, 5.0, 0]])
    sharp = np.array([[3, 0, 4, math.pi, 5.0]])
    plans = planner.plan(state, sharp)
    assert plans.status[0] == PlanStatus.FAILED
    assert np.isnan(plans.path).all()
    last = planner.plan(state, np.array([[4, 20, 0, 0, 5.0]])).path
    kept = planner.plan(state, sharp, None, last, 1.0)
    assert kept.status[0] == PlanStatus.SHIFTED
    times = np.linspace(0, 3, 32)
    np.testing.assert_allclose(kept.path[0, :, 0], times, atol=1e-9)
    np.testing.assert_allclose(kept.path[0, :, 1], 5 + 5 * times, atol=1e-6)
    assert planner.plan(state, sharp, None, last, 4.5).status[0] == PlanStatus.FAILED
