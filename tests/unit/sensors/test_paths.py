"""Waypoints, on the route and on the whole road."""

import math

import numpy as np
import pytest

from smarts.agents.options import RoadWaypoints, Waypoints
from smarts.sensors.road_waypoints import RoadWaypointsAround
from smarts.sensors.waypoint_paths import WaypointPathsAhead
from smarts.types.guidance import GuidePhase
from smarts.types.mission import AgentMission
from tests.maps import Road, graph_of, straight
from tests.unit.sensors.seeing import (
    BEND,
    RADIUS,
    STRAIGHT_ON,
    TO_THE_LEFT,
    at_crossing,
    in_bend,
    on_bend,
    seen,
)
from tests.worlds import Car, world_of


def ahead(**option):
    return WaypointPathsAhead(Waypoints(**option))


def around(**option):
    return RoadWaypointsAround(RoadWaypoints(**option))


def test_paths_in_a_curve_are_the_lanes_beside():
    paths = seen(ahead(lookahead=12), in_bend(on_bend(0.3, RADIUS + 0.4, mission=BEND)))
    assert paths["path_count"] == 2
    assert paths["waypoint_count"].tolist() == [12, 12, *[0] * 6]
    for path, radius in enumerate((RADIUS, RADIUS - 3.2)):
        angles = 0.3 + np.arange(12) / radius
        circle = radius * np.stack((np.cos(angles), np.sin(angles)), -1)
        assert paths["position"][path] == pytest.approx(circle, abs=0.02)
        assert paths["heading"][path] == pytest.approx(angles + math.pi / 2, abs=0.01)
        assert paths["lane_offset"][path] == pytest.approx(angles * radius, abs=0.03)
        assert set(paths["lane"][path].tolist()) == set(paths["lane_index"][path].tolist()) == {path}
    assert set(paths["lane_width"][:2].ravel().tolist()) == {np.float32(3.2)}
    assert set(paths["speed_limit"][:2].ravel().tolist()) == {14.0}
    assert not paths["position"][2:].any()


def test_the_whole_road_has_oncoming_lanes():
    made = at_crossing(Car(-40.0, -1.0, mission=STRAIGHT_ON))
    road = seen(around(horizon=10), made)
    assert road["lane_count"] == 2
    assert road["oncoming"].tolist()[:2] == [0, 1]
    assert road["beside"][:2].tolist() == [10, 10]
    assert road["waypoint_count"][:2].tolist() == [21, 21]
    assert road["position"][0, :, 0] == pytest.approx(-50.0 + np.arange(21))
    assert road["position"][1, :, 0] == pytest.approx(-30.0 - np.arange(21))
    assert set(road["position"][:2, :, 1].ravel().round(6).tolist()) == {-1.6, 1.6}
    names = [made.atlas.graphs[0].lane_ids[lane] for lane in road["lane"][:2, 0]]
    assert names == ["west_in_0", "west_out_0"]


def test_of_a_wide_road_the_lanes_beside_the_own_one_are_kept():
    for own, first in ((0, 0), (3, 0), (6, 3), (11, 4)):
        # Left of the lane's middle, so that the neighbour on the left is the nearer one.
        mission = AgentMission(route=("road",))
        made = world_of([Car(50.0, 3.2 * own + 0.5, mission=mission)], maps=[straight(lanes=12)])
        road = seen(around(horizon=2), made)
        assert road["lane_index"][:, 0].tolist() == [*range(first, first + 8)]
        assert (road["lane_count"], road["left_out"]) == (8, 4)
        assert seen(ahead(lookahead=4), made)["left_out"] == 4


def test_the_road_in_a_curve_and_at_its_end():
    made = in_bend(on_bend(0.105, mission=BEND))
    road = seen(around(horizon=5), made)
    # 3.15 m of the right lane lie behind, 2.81 m of the left one.
    assert road["beside"][:2].tolist() == [3, 2]
    assert road["waypoint_count"][:2].tolist() == [9, 8]
    angles = 0.105 + np.arange(-3, 6) / RADIUS
    circle = RADIUS * np.stack((np.cos(angles), np.sin(angles)), -1)
    assert road["position"][0, :9] == pytest.approx(circle, abs=0.01)
    assert not road["position"][0, 9:].any()


def test_beyond_the_road_the_way_that_turns_least_is_taken():
    made = at_crossing(Car(-12.0, -1.6, mission=TO_THE_LEFT))
    road = seen(around(horizon=30), made)
    assert road["position"][0, :, 1] == pytest.approx(-1.6)
    assert road["position"][1, :, 1] == pytest.approx(1.6)


def led(phase, *, x=50.0, speed=0.0, **curve):
    """Return the paths of a led agent on a road of two lanes each way, with waypoints every 3 m."""
    roads = {"there": Road([(0, 0), (200, 0)], 2), "back": Road([(200, 12.8), (0, 12.8)], 2)}
    made = world_of([Car(x, 0.0, mission=AgentMission(route=("there",)))], maps=[graph_of(roads)])
    guidance = made.world.guidance
    guidance.phase[0, 0], guidance.speed[0, 0] = phase, speed
    for name, value in curve.items():
        getattr(guidance, name)[0, 0] = value
    return seen(ahead(lookahead=15, spacing=3.0), made)


def test_who_approaches_a_manoeuvre_sees_its_lane_alone():
    paths = led(GuidePhase.APPROACH, speed=8.0)
    assert (paths["path_count"], paths["waypoint_count"].tolist()) == (1, [15, *[0] * 7])
    assert paths["position"][0].tolist() == [[50.0 + 3.0 * i, 0.0] for i in range(15)]
    assert paths["speed_limit"][0].tolist() == [8.0] * 15
    assert not paths["position"][1:].any()


@pytest.mark.parametrize("phase", [GuidePhase.FREE, GuidePhase.OVER])
def test_who_is_not_led_sees_all_lanes(phase):
    paths = led(phase, speed=8.0)
    assert paths["path_count"] == 2
    assert paths["speed_limit"][:2].tolist() == [[8.0] * 15] * 2
    assert paths["position"].tolist() == led(phase)["position"].tolist()
    assert led(phase)["speed_limit"][0].tolist() == [14.0] * 15


def test_a_manoeuvre_is_a_path_out_of_the_lane_and_on_along_the_other():
    # The half circle is about 20.2 m long: seven waypoints on it, the others from 0.9 m behind it.
    paths = led(GuidePhase.MANOEUVRE, begin=(50.0, 0.0, 0.0), lane=2, s=150.0)
    assert (paths["path_count"], paths["waypoint_count"][0]) == (1, 15)
    places, headings = paths["position"][0], paths["heading"][0]
    assert places[0].tolist() == [50.0, 0.0]
    assert np.hypot(*(places[:7] - (50.0, 6.4)).T) == pytest.approx(6.4, rel=0.02)
    assert headings[:7] == pytest.approx(np.arange(7) * 3.0 / 6.4, abs=0.1)
    assert places[7:, 0] == pytest.approx(49.1 - 3.0 * np.arange(8), abs=0.2)
    assert places[7:, 1] == pytest.approx(12.8)
    # It crosses the own left lane, as far as y = 6.4, and then both lanes of the other road.
    assert paths["lane"][0].tolist() == [0, 0, 1, 1, 3, 3, 2, *[2] * 8]
    assert paths["lane_index"][0].tolist() == [0, 0, 1, 1, 1, 1, 0, *[0] * 8]
    assert paths["lane_offset"][0, 7:] == pytest.approx(150.9 + 3.0 * np.arange(8), abs=0.2)
    assert paths["lane_width"][0] == pytest.approx(3.2)
