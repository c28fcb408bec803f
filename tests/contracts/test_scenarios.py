"""Properties of every scenario that `scenarios/suite.yaml` lists."""

from pathlib import Path

import numpy as np
import pytest

from perf.scenario_traffic import FULL, density, flow, mission_routes
from smarts.envision.route_lines import CAR_LENGTH, pose_on_map, route_line, start_pose
from smarts.sstudio import types as t
from smarts.sstudio.build import build_scenario, suite
from smarts.sstudio.built import BuiltScenario
from smarts.sstudio.missions import place_missions
from smarts.types.streams import Purpose, stream

NAMES = tuple(suite())
PAPER = [
    "u_turn",
    "lane_merge",
    "intersection",
    "overtaking",
    "two_way",
    "unprotected_left_turn",
    "cut_in",
    "on_ramp_merge",
    "off_ramp_merge",
    "cascading_lane_change",
    "bus_stop_merge",
    "roundabout",
]
BENCHMARK = ("two_way", "double_merge", "intersection")
LEAST_AROUND_EGOS = {"intersection": 15.0}
LEAST_ELSEWHERE = 8.0
LONGEST_STAND = 180.0
"""Maximum time that a vehicle stands [s]; beyond it, the vehicle is stuck."""
CLEAR = 15.0
"""Minimum distance between egos' starts and vehicles that depart during episodes [m]."""

SLOW_ONES = [pytest.param(name, marks=pytest.mark.slow) for name in NAMES]
ALL_HELD_OUT = "@*"
WITH_VARIATIONS = [*NAMES, *(pytest.param(name + ALL_HELD_OUT, marks=pytest.mark.slow) for name in NAMES)]
"""Building all variations takes a minute the first time."""


def builds(case: str) -> list[BuiltScenario]:
    """Return a scenario by its name, or its held-out variations by "name@*"."""
    base = build_scenario(case.removesuffix(ALL_HELD_OUT))
    if not case.endswith(ALL_HELD_OUT):
        return [base]
    return [build_scenario(f"{base.name}@{variation}") for variation in base.held_out]


def test_the_suite_begins_with_the_papers():
    assert list(NAMES)[: len(PAPER)] == PAPER


@pytest.mark.parametrize("name", NAMES)
def test_has_both_traffics(name):
    built = build_scenario(name)
    assert list(built.traffic) == ["no_social_vehicles", FULL]
    scenario_traffic = built.scenario.traffic
    assert not scenario_traffic["no_social_vehicles"].flows
    assert not scenario_traffic["no_social_vehicles"].trips
    assert 10 <= scenario_traffic[FULL].warm_up <= 40


@pytest.mark.parametrize("name", NAMES)
def test_has_patient_and_impatient_drivers(name):
    traffic = build_scenario(name).scenario.traffic[FULL]
    factors = {actor.speed.mean for flow in traffic.flows for actor in flow.actors}
    factors |= {trip.actor.speed.mean for trip in traffic.trips or ()}
    assert {0.8, 1.0} <= factors


@pytest.mark.parametrize("case", WITH_VARIATIONS)
def test_every_mission_can_be_driven(case):
    for built in builds(case):
        roads = built.roads()
        for mission in built.scenario.ego_missions:
            line = route_line(roads, mission.route)
            gaps = np.hypot(*np.diff(line, axis=0).T)
            x, y, heading = start_pose(roads, mission)
            bumper = x + CAR_LENGTH / 2 * np.cos(heading), y + CAR_LENGTH / 2 * np.sin(heading)
            assert line[0] == pytest.approx(bumper, abs=0.5)
            assert line[-1] == pytest.approx(pose_on_map(roads, mission.route.end)[:2], abs=0.5)
            # The line follows all lanes between; only lane changes are long segments.
            assert gaps.max() < 30.0


@pytest.mark.parametrize("name", BENCHMARK)
def test_the_benchmarks_scenarios_have_four_egos(name):
    assert len(build_scenario(name).scenario.ego_missions) == 4


@pytest.mark.parametrize("case", WITH_VARIATIONS)
def test_starts_vary_and_stay_on_their_lane(case):
    for built in builds(case):
        roads, scenario = built.roads(), built.scenario
        low, high = scenario.start_variation.speed
        assert low < high
        seen = set()
        for seed in range(20):
            placed = place_missions(
                scenario.ego_missions, roads, stream(seed, Purpose.STARTS), scenario.start_variation
            )
            for ego in placed:
                nominal = roads.arc_length(ego.start.lane, ego.mission.route.begin[2])
                assert ego.start.s > 2.5
                assert ego.start.s <= roads.length[ego.start.lane]
                assert abs(ego.start.s - nominal) <= 5.0001
                assert low <= ego.speed <= high
            seen.add(tuple(round(ego.start.s, 6) for ego in placed))
        assert len(seen) == 20


@pytest.mark.parametrize("case", WITH_VARIATIONS)
def test_traffic_does_not_depart_where_egos_start(case):
    for built in builds(case):
        traffic = built.scenario.traffic[FULL]
        for ego in mission_routes(built):
            for flow_ in traffic.flows:
                if not isinstance(flow_.route, t.Route) or flow_.end <= traffic.warm_up:
                    continue
                road, lane, offset = flow_.route.begin
                if (road, lane) == tuple(ego.begin[:2]):
                    assert abs((0.0 if offset == "base" else offset) - ego.begin[2]) >= CLEAR


@pytest.mark.parametrize("name", NAMES)
def test_has_at_least_three_held_out_variations(name):
    assert len(build_scenario(name).held_out) >= 3


@pytest.mark.parametrize("name", SLOW_ONES)
def test_held_out_variations_differ_from_the_scenario_and_each_other(name):
    variations = [*builds(name), *builds(name + ALL_HELD_OUT)]
    assert len({built.directory for built in variations}) == len(variations)


@pytest.mark.parametrize("name", NAMES)
def test_has_a_page(name):
    text = Path(build_scenario(name).source, "README.md").read_text()
    assert len(text) > 500
    assert "**How it fails.**" in text
    assert "**Numbers.**" in text


@pytest.mark.parametrize(
    "name",
    [n if n == "loop" else pytest.param(n, marks=pytest.mark.slow) for n in NAMES if n != "city"],
)
def test_has_dense_traffic_from_the_start(name):
    full = density(build_scenario(name), episodes=8)
    least = LEAST_AROUND_EGOS.get(name, LEAST_ELSEWHERE)
    assert full.around_egos >= least
    assert full.at_start >= 0.75 * least


@pytest.mark.slow
def test_the_city_holds_three_hundred_vehicles():
    full = density(build_scenario("city"), episodes=3)
    assert full.fewest >= 300
    assert full.around_egos >= LEAST_ELSEWHERE


@pytest.mark.parametrize("name", SLOW_ONES)
def test_traffic_flows_and_does_not_collide(name):
    moving = flow(build_scenario(name))
    assert moving.speed > 4.0
    assert moving.last_speed > 3.0
    assert moving.longest_stand < LONGEST_STAND
    # At signals, some drivers run red lights, as in the paper's listing.
    assert moving.collisions <= (0.5 * moving.vehicle_hours if name == "city" else 0)
