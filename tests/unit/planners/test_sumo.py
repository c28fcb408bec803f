"""SUMO's planner against SUMO itself, and against hand-computed cases."""

import math

import numpy as np
import pytest

from smarts.planners import CarFollowing, Neighbours, PlanStatus, SumoPlanner, resample
from smarts.planners.sumo import LANE, brake_gap, follow_speed, stop_speed
from tests.unit.providers.conftest import Country, World
from tests.unit.providers.test_sumo_shadows import LEFT, RIGHT, drivers

SIZE = np.array([5.0, 1.8])
TARGET = np.array([6.0, 1000.0, LEFT, 0.0, 20.0])
"""In the left lane, at the road's limit."""


@pytest.fixture(scope="module")
def country(tmp_path_factory):
    return Country(tmp_path_factory.mktemp("country"))


@pytest.fixture
def world(country):
    made = World(country)
    yield made
    made.traffic.close()


def plan(state, target, *others):
    """Return the path of one vehicle among others: x, y, heading, speed each."""
    path = np.array([[0.0, *row] for row in others]).reshape(1, -1, 1, 5)
    around = Neighbours(path, np.tile(SIZE, (1, len(others), 1)))
    plans = SumoPlanner().plan(np.array([state], float), np.array([target], float), around)
    assert plans.status[0] == PlanStatus.PLANNED
    return plans.path[0]


def pose(world, name):
    slot, states = world.slot(name), world.states
    return [*states.position[slot], states.heading[slot], states.speed[slot]]


def driven(world, name, steps):
    """Return what SUMO drives: rows of time, x, y, heading, speed at each step."""
    rows = [[0.0, *pose(world, name)]]
    for step in range(steps):
        world.step()
        rows.append([0.1 * (step + 1), *pose(world, name)])
    return np.array(rows)


def test_it_accelerates_and_follows_as_sumo_does(world, country):
    slow = '<vType id="slow" sigma="0" speedFactor="1" maxSpeed="6" lcSpeedGain="0" lcKeepRight="0"/>'
    routes = drivers((0, 100, 8), (0, 160, 6)).replace('id="s1" type="calm"', 'id="s1" type="slow"')
    world.reset(country.road(slow + routes))
    world.step(3)
    begin, leader = pose(world, "s0"), pose(world, "s1")
    found = plan([*begin, 0.0], [6.0, 1000.0, RIGHT, 0.0, 20.0], leader)
    expected = driven(world, "s0", 60)[::3]
    assert expected[:, 4].max() > 11.0, "it accelerates"
    assert expected[-1, 4] < 10.0, "it brakes behind its leader"
    np.testing.assert_allclose(found[:, [0, 2, 4]], expected[:, [0, 2, 4]], atol=0.02)
    np.testing.assert_allclose(found[:, 1], expected[:, 1], atol=0.1)


def test_it_changes_lanes_as_sumo_does(world, country):
    world.reset(country.road(drivers((0, 100, 12), (1, 170, 20), (1, 60, 10))))
    world.step(3)
    vehicle = world.traffic._library.vehicle
    vehicle.changeLane("s0", 1, 100.0)
    begin, others = pose(world, "s0"), [pose(world, name) for name in ("s1", "s2")]
    found = plan([*begin, 0.0], TARGET, *others)
    expected = driven(world, "s0", 60)[::3]
    assert expected[-1, 2] == pytest.approx(LEFT, abs=0.05)
    np.testing.assert_allclose(found[:, 2], expected[:, 2], atol=0.1)
    np.testing.assert_allclose(found[:, 3], expected[:, 3], atol=0.02)
    np.testing.assert_allclose(found[:, 4], expected[:, 4], atol=0.05)
    np.testing.assert_allclose(found[:, 1], expected[:, 1], atol=0.2)


def test_a_change_waits_for_the_gap_behind():
    """A faster vehicle from behind passes first; then the change takes its 3 s."""
    path = plan([0, 0, 0, 10, 0], [6, 100, LANE, 0, 10], [-25, LANE, 0, 18])
    times, offsets = path[:, 0], path[:, 2]
    begun = times[np.flatnonzero(offsets > 1e-9)[0]]
    # Its rear is the least gap ahead of the front, and more by what it brakes harder: at once, it is faster.
    assert 25.0 + 5.0 + 2.5 <= 8.0 * begun <= 25.0 + 5.0 + 2.5 + 8.0 * 0.4
    assert offsets[times < begun - 0.05] == pytest.approx(0.0)
    assert times[-1] - begun > 1.2
    assert (offsets[-1] - offsets[-2]) / 0.3 == pytest.approx(LANE / 3.0, abs=0.02)


def test_a_change_that_has_begun_goes_on():
    """Half-way over, one close behind in the target's lane stops it no more; on the way back it does."""
    turn = math.atan2(LANE / 3.0, 10.0)
    beside = [-6, LANE, 0, 10]
    path = plan([0, 0.5 * LANE, turn, 10, 0], [6, 100, LANE, 0, 10], beside)
    assert path[8, 2] == pytest.approx(LANE, abs=0.05)
    back = plan([0, 0.5 * LANE, -turn, 10, 0], [6, 100, LANE, 0, 10], beside)
    assert abs(back[8, 2] - 0.5 * LANE) < 0.5


def test_leaders_of_both_lanes_count_during_a_change():
    alone = plan([0, 0, 0, 15, 0], [6, 100, LANE, 0, 15])
    own = plan([0, 0, 0, 15, 0], [6, 100, LANE, 0, 15], [25, 0, 0, 5])
    theirs = plan([0, 0, 0, 15, 0], [6, 100, LANE, 0, 15], [70, LANE, 0, 5])
    aside = plan([0, 0, 0, 15, 0], [6, 100, LANE, 0, 15], [25, -LANE, 0, 5])
    assert own[3, 4] < 14.5
    assert theirs[-1, 4] < 10.0
    np.testing.assert_array_equal(aside, alone)
    assert alone[:, 4] == pytest.approx(15.0)


def test_the_equations_by_hand():
    # From 4.5 m/s, losing 0.45 m/s in each of ten steps: 0.1 (10 * 4.5 - 0.45 * 55) m, and 1 s at 4.5 m/s.
    assert brake_gap(4.5, 4.5, 1.0) == pytest.approx(0.1 * (45.0 - 24.75) + 4.5)
    # `stop_speed` is the speed whose braking way with a time gap is the gap.
    for speed in (0.3, 2.0, 7.3, 19.0):
        gap = brake_gap(speed, 4.5, 1.0)
        assert stop_speed(gap + 1e-3, 4.5, 1.0) == pytest.approx(speed, abs=0.03)
    assert stop_speed(-1.0, 4.5, 1.0) == 0.0
    model = CarFollowing()
    assert follow_speed(-5.0, 15.0, 0.0, model) == pytest.approx(15.0 - 0.9), "emergency braking"
    # It stops on 20 m by 15^2 / 40 = 5.6 m/s^2, and brakes by a fifth more.
    assert follow_speed(20.0, 15.0, 0.0, model) == pytest.approx(15.0 - 0.1 * 1.2 * 5.625)


def test_rows_are_independent_and_failures_keep_the_last_path():
    states = np.array([[0, 0, 0, 10, 0], [0, 0, 1.2, 10, 0], [np.nan, 0, 0, 10, 0]])
    targets = np.tile([6, 100, LANE, 0, 12.0], (3, 1))
    planner = SumoPlanner()
    plans = planner.plan(states, targets)
    assert plans.status.tolist() == [PlanStatus.PLANNED, PlanStatus.FAILED, PlanStatus.FAILED]
    np.testing.assert_array_equal(planner.plan(states[:1], targets[:1]).path[0], plans.path[0])
    last = np.tile(plans.path[:1], (3, 1, 1))
    kept = planner.plan(states, targets, None, last, 1.0)
    assert kept.status.tolist() == [PlanStatus.PLANNED, PlanStatus.SHIFTED, PlanStatus.SHIFTED]
    np.testing.assert_allclose(kept.path[1, 0, 1:], resample(last[1:2], np.array([[1.0]]))[0, 0, 1:])
