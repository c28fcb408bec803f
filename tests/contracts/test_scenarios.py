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


def nightly_but(*names: str) -> list:
    """Return the scenarios as parameters, of which all but some are for the nightly tests."""
    return [name if name in names else pytest.param(name, marks=pytest.mark.nightly) for name in NAMES]


def variations(name: str) -> list[BuiltScenario]:
    """Return the held-out variations of a scenario."""
    return [build_scenario(f"{name}@{variation}") for variation in build_scenario(name).held_out]


def test_the_suite_begins_with_the_papers():
    assert list(NAMES)[: len(PAPER)] == PAPER


@pytest.mark.parametrize("name", NAMES)
def test_every_scenario_is_complete(name):
    built = build_scenario(name)
    assert list(built.traffic) == ["no_social_vehicles", FULL]
    empty, full = built.scenario.traffic.values()
    assert not empty.flows
    assert not empty.trips
    assert 10 <= full.warm_up <= 40
    factors = {actor.speed.mean for flow in full.flows for actor in flow.actors}
    factors |= {trip.actor.speed.mean for trip in full.trips or ()}
    assert {0.8, 1.0} <= factors, "patient and impatient drivers"
    assert len(built.held_out) >= 3
    if name in BENCHMARK:
        assert len(built.scenario.ego_missions) == 4
    text = Path(built.source, "README.md").read_text()
    assert "**How it fails.**" in text
    assert "**Numbers.**" in text
    check_missions(built, seeds=5)
    check_departures(built)


@pytest.mark.parametrize("name", nightly_but("loop"))
def test_held_out_variations_are_as_complete(name):
    found = variations(name)
    assert len({built.directory for built in [build_scenario(name), *found]}) == 1 + len(found)
    for built in found:
        check_missions(built, seeds=20)
        check_departures(built)


def check_missions(built: BuiltScenario, seeds: int) -> None:
    """Check that every mission can be driven, and that starts vary and stay on their lane."""
    roads, scenario = built.roads(), built.scenario
    for mission in scenario.ego_missions:
        line = route_line(roads, mission.route)
        gaps = np.hypot(*np.diff(line, axis=0).T)
        x, y, heading = start_pose(roads, mission)
        bumper = x + CAR_LENGTH / 2 * np.cos(heading), y + CAR_LENGTH / 2 * np.sin(heading)
        assert line[0] == pytest.approx(bumper, abs=0.5)
        assert line[-1] == pytest.approx(pose_on_map(roads, mission.route.end)[:2], abs=0.5)
        # The line follows all lanes between; only lane changes are long segments.
        assert gaps.max() < 30.0
    low, high = scenario.start_variation.speed
    assert low < high
    seen = set()
    for seed in range(seeds):
        generator = stream(seed, Purpose.STARTS)
        placed = place_missions(scenario.ego_missions, roads, generator, scenario.start_variation)
        for ego in placed:
            nominal = roads.arc_length(ego.start.lane, ego.mission.route.begin[2])
            assert 2.5 < ego.start.s <= roads.length[ego.start.lane]
            assert abs(ego.start.s - nominal) <= 5.0001
            assert low <= ego.speed <= high
        seen.add(tuple(round(ego.start.s, 6) for ego in placed))
    assert len(seen) == seeds


def check_departures(built: BuiltScenario) -> None:
    """Check that no traffic departs during episodes where egos start."""
    traffic = built.scenario.traffic[FULL]
    for ego in mission_routes(built):
        for flow_ in traffic.flows:
            if not isinstance(flow_.route, t.Route) or flow_.end <= traffic.warm_up:
                continue
            road, lane, offset = flow_.route.begin
            if (road, lane) == tuple(ego.begin[:2]):
                assert abs((0.0 if offset == "base" else offset) - ego.begin[2]) >= CLEAR


@pytest.mark.parametrize(
    "name", [each for each in nightly_but("loop") if getattr(each, "values", None) != ("city",)]
)
def test_has_dense_traffic_from_the_start(name):
    full = density(build_scenario(name), episodes=8)
    least = LEAST_AROUND_EGOS.get(name, LEAST_ELSEWHERE)
    assert full.around_egos >= least
    assert full.at_start >= 0.75 * least


@pytest.mark.nightly
def test_the_city_holds_three_hundred_vehicles():
    full = density(build_scenario("city"), episodes=3)
    assert full.fewest >= 300
    assert full.around_egos >= LEAST_ELSEWHERE


@pytest.mark.slow
@pytest.mark.parametrize("name", nightly_but("roundabout"))
def test_traffic_flows_and_does_not_collide(name):
    moving = flow(build_scenario(name))
    assert moving.speed > 4.0
    assert moving.last_speed > 3.0
    assert moving.longest_stand < LONGEST_STAND
    # At signals, some drivers run red lights, as in the paper's listing.
    assert moving.collisions <= (0.5 * moving.vehicle_hours if name == "city" else 0)
