"""The controllers other than lane following, compared with cases worked out by hand."""

import math

import numpy as np
import pytest

from smarts.controllers.lane_actions import LaneFormat
from smarts.types.actions import ActionSpaceType
from smarts.types.vehicles import VehicleKind
from tests import maps
from tests.unit.controllers.rig import agent, winding

T = ActionSpaceType


@pytest.fixture
def straight(rig):
    def make(kind, *, speed=10.0, y=0.0, **options):
        graph = maps.straight(lanes=3, length=600.0)
        return rig([agent(20.0, y, speed=speed)], graph=graph, kind=kind, **options)

    return make


@pytest.mark.parametrize(("given", "number"), [("keep_lane", 0), ("change_lane_left", 2), (3, 3), (1.0, 1)])
def test_lane_actions_by_name_or_number(given, number):
    assert LaneFormat().parse(given, "", 0) == number


class TestContinuous:
    def test_actuators_are_applied(self, straight):
        driven = straight(T.Continuous)
        driven.act(0.5, 0.0, 0.1)
        driven.step(3)
        assert driven.agents.throttle[0, 0] == 0.5
        assert driven.agents.brake[0, 0] == 0.0
        assert driven.agents.steering[0, 0] > 0.01
        assert driven.world.vehicles.yaw_rate[0, 0] > 0.0


def test_the_steering_turns_at_the_commanded_rate(straight):
    driven = straight(T.ActuatorDynamic, speed=2.0)
    driven.act(0.0, 0.0, 0.5)
    angles = [float(driven.step().agents.steering[0, 0]) for _ in range(8)]
    lock = float(driven.vehicles.fleet._cars["max_steering"][0])
    assert np.diff(angles) == pytest.approx(0.5 * 0.1 * lock)


def sinus(length=300.0, speed=10.0, amplitude=3.0, wave=80.0):
    """Return a path of time, x, y, heading, speed that begins at (20, 0)."""
    x = np.linspace(0.0, length, 64)
    y = amplitude * (1.0 - np.cos(2 * np.pi * x / wave)) / 2
    slope = amplitude * np.pi / wave * np.sin(2 * np.pi * x / wave)
    return np.stack([x / speed, 20.0 + x, y, np.arctan(slope), np.full_like(x, speed)], 1)


def distance_to(path, point):
    """Return the distance of a point to the polyline of a path [m]."""
    begin, end = path[:-1, 1:3], path[1:, 1:3]
    way = end - begin
    share = np.clip(((point - begin) * way).sum(1) / (way**2).sum(1), 0.0, 1.0)
    return float(np.linalg.norm(begin + share[:, None] * way - point, axis=1).min())


@pytest.mark.parametrize(
    ("kind", "vehicle"), [(T.Trajectory, VehicleKind.PASSENGER), (T.MPC, VehicleKind.BUS)]
)
def test_tracks_a_path(rig, kind, vehicle):
    graph = maps.straight(lanes=3, length=600.0)
    driven = rig([agent(20.0, 0.0, speed=10.0, kind=vehicle)], graph=graph, kind=kind)
    path = sinus(length=200.0)
    driven.act(path=path)
    far = []
    for _ in range(150):
        driven.step()
        far.append(distance_to(path, driven.position))
    assert max(far) < 0.3
    assert driven.speed == pytest.approx(10.0, abs=0.2)


@pytest.mark.parametrize("kind", [T.Trajectory, T.MPC])
def test_stops_beyond_the_end_of_a_path(rig, kind):
    driven = rig([agent(20.0, 0.0, speed=10.0)], graph=maps.straight(length=600.0), kind=kind)
    path = sinus(length=40.0, amplitude=0.0)
    driven.act(path=path)
    driven.step(120)
    assert driven.speed == pytest.approx(0.0, abs=0.05)
    assert 60.0 < driven.position[0] < 82.0


@pytest.mark.parametrize("kind", [T.Trajectory, T.MPC])
def test_speeds_below_zero_stop_the_vehicle(rig, kind):
    """It was driven forwards at the speed's magnitude; no vehicle that tracks a path drives backwards."""
    driven = rig([agent(20.0, 0.0, speed=3.0)], graph=maps.straight(length=600.0), kind=kind)
    path = sinus(length=200.0, amplitude=0.0)
    path[:, 4] = -5.0
    driven.act(path=path)
    driven.step(30)
    assert driven.speed == pytest.approx(0.0, abs=0.05)


def test_model_predictive_control_cuts_a_corner_that_is_too_sharp(rig):
    """At a corner of 90 degrees at 6 m/s, the controller that plans ahead has the smaller offset."""
    far = {}
    x = np.linspace(0.0, 40.0, 32)
    points = np.concatenate([np.stack([20.0 + x, 0.0 * x], 1), np.stack([60.0 + 0.0 * x, x], 1)[1:]])
    headings = np.where(np.arange(len(points)) < 32, 0.0, math.pi / 2)
    path = np.column_stack([np.zeros(len(points)), points, headings, np.full(len(points), 6.0)])
    for kind in (T.Trajectory, T.MPC):
        driven = rig([agent(20.0, 0.0, speed=6.0)], graph=winding(40.0), kind=kind)
        driven.act(path=path)
        far[kind] = 0.0
        for _ in range(110):
            driven.step()
            far[kind] = max(far[kind], distance_to(path, driven.position))
    assert far[T.MPC] < far[T.Trajectory]


class TestTargetPose:
    def test_arrives_at_the_pose_in_time(self, straight):
        driven = straight(T.TargetPose)
        driven.act(40.0, 3.2, 0.1, 2.0)
        driven.step(20)
        assert driven.position == pytest.approx([40.0, 3.2])
        assert driven.world.vehicles.heading[0, 0] == pytest.approx(0.1)
        driven.step()
        assert driven.position == pytest.approx(
            [40.0 + math.cos(0.1) * driven.speed * 0.1, 3.2 + 0.1], abs=0.02
        )

    def test_relative_poses_act_once(self, straight):
        driven = straight(T.RelativeTargetPose)
        driven.act(1.0, 0.1, 0.05)
        driven.step()
        assert driven.position == pytest.approx([21.0, 0.1])
        assert driven.world.vehicles.heading[0, 0] == pytest.approx(0.05)
        driven.step()
        assert driven.position == pytest.approx([21.0, 0.1])
        assert driven.world.vehicles.heading[0, 0] == pytest.approx(0.05)
        assert driven.speed == 0.0

    def test_a_change_of_pose_lasts_until_the_next_decision(self, straight):
        driven = straight(T.RelativeTargetPose, speed=0.0)
        driven.agents.period[0, 0] = 5
        driven.act(1.0, 0.0, 0.0)
        log = driven.log(7, "speed")
        assert log[:, 0] == pytest.approx([2.0] * 5 + [0.0] * 2)
        assert driven.position[0] == pytest.approx(21.0)

    def test_a_far_target_is_approached_at_100_m_s(self, straight):
        """The target is 150 m away, and the time one step."""
        driven = straight(T.TargetPose, speed=0.0)
        driven.act(170.0, 0.0, 0.0, 0.1)
        for way in (10.0, 20.0):
            driven.step()
            assert driven.position == pytest.approx([20.0 + way, 0.0])
            assert driven.speed == 100.0
        assert driven.tracks.poses[0, 0, :, 0] == pytest.approx(30.0 + np.arange(1, 11))


def test_a_path_with_times_is_followed_exactly(straight):
    driven = straight(T.TrajectoryWithTime)
    path = np.array([[0.0, 20.0, 0.0, 0.0, 10.0], [1.0, 30.0, 1.0, 0.2, 12.0], [2.0, 42.0, 1.0, -0.2, 12.0]])
    driven.act(path=path)
    driven.step(5)
    assert driven.position == pytest.approx([25.0, 0.5])
    assert driven.speed == pytest.approx(11.0)
    driven.step(10)
    assert driven.position == pytest.approx([36.0, 1.0])
    assert driven.world.vehicles.heading[0, 0] == pytest.approx(0.0)
    driven.step(10)
    assert driven.position == pytest.approx([42.0 + 6.0 * math.cos(-0.2), 1.0 + 6.0 * math.sin(-0.2)])


def test_a_path_of_one_point_begins_and_ends_there(straight):
    driven = straight(T.TrajectoryWithTime)
    driven.act(path=np.array([[0.5, 22.0, 1.0, 0.0, 4.0]]))
    driven.actions.path[0, 0, 1:] = math.nan
    driven.step(3)
    assert driven.position == pytest.approx([22.0, 1.0])
    assert driven.speed == pytest.approx(4.0)
    driven.step(3)
    assert driven.position == pytest.approx([22.4, 1.0])


class TestDirect:
    def test_acceleration_and_yaw_rate(self, straight):
        driven = straight(T.Direct)
        driven.act(2.0, 0.5)
        driven.step(10)
        assert driven.speed == pytest.approx(12.0)
        assert driven.world.vehicles.heading[0, 0] == pytest.approx(0.5)
        assert driven.world.vehicles.acceleration[0, 0] == pytest.approx(2.0)
        assert driven.world.vehicles.yaw_rate[0, 0] == pytest.approx(0.5)

    def test_speed(self, straight):
        driven = straight(T.Direct)
        driven.act(4.0, 0.0, 1.0)
        driven.step(10)
        assert driven.position == pytest.approx([24.0, 0.0])
        assert driven.speed == 4.0

    def test_braking_ends_at_standstill(self, straight):
        driven = straight(T.Direct, speed=3.0)
        driven.act(-5.0, 0.0)
        driven.step(20)
        assert driven.speed == 0.0
        assert driven.position[0] == pytest.approx(20.9, abs=0.02)
