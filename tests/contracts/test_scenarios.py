"""Properties of every scenario that `scenarios/suite.yaml` lists."""

import subprocess
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from smarts.envision.route_lines import CAR_LENGTH, pose_on_map, route_line, start_pose
from smarts.providers.sumo_traffic import sumo_options
from smarts.sim.traffic_run import traffic_run
from smarts.sstudio import types as t
from smarts.sstudio.build import build_scenario, suite
from smarts.sstudio.built import BuiltScenario
from smarts.sstudio.episodes import expand
from smarts.sstudio.missions import place_missions
from smarts.types.streams import Purpose, stream
from smarts.types.vehicles import VehicleKind

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
FULL = "random_social_vehicles"
LEAST_AROUND_EGOS = {"intersection": 15.0, "intersections": 6.0}
LEAST_ELSEWHERE = 8.0
"""A family of maps has a traffic of its own that is denser, `dense`."""
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
    empty, full = [built.scenario.traffic[each] for each in ("no_social_vehicles", FULL)]
    assert list(built.traffic)[:2] == ["no_social_vehicles", FULL]
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
    missions = expand(scenario.ego_missions)
    for mission in missions:
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
        placed = place_missions(missions, roads, generator, scenario.start_variation)
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


def mission_routes(built: BuiltScenario) -> list[t.Route]:
    """Return the fixed routes among the missions."""
    missions = [each for each in expand(built.scenario.ego_missions or ()) if isinstance(each, t.Mission)]
    return [mission.route for mission in missions if isinstance(mission.route, t.Route)]


def density(built: BuiltScenario, episodes: int) -> tuple[float, float, int]:
    """Count the vehicles within 100 m of places on the egos' ways, in the first 30 s of some episodes.

    Returns:
        The mean at the start, the mean over the whole time, and the fewest vehicles on the map.
    """
    places = []
    for route in mission_routes(built):
        line = route_line(built.roads(), route)
        s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
        at = np.arange(0.0, s[-1], 10.0)
        places.append(np.stack([np.interp(at, s, line[:, axis]) for axis in (0, 1)], axis=1))

    def around(states) -> float:
        offset = states.position[states.alive][None] - np.concatenate(places)[:, None]
        return float((np.hypot(*np.moveaxis(offset, -1, 0)) < 100.0).sum(axis=1).mean())

    starts, whole, vehicles = [], [], []
    for episode in range(episodes):
        with traffic_run(built, FULL, seed=0, episode=episode) as run:
            starts.append(around(run.states))
            for step, states in enumerate(run.steps(30.0)):
                if step % 5 == 0:
                    whole.append(around(states))
                    vehicles.append(int(states.alive.sum()))
    return float(np.mean(starts)), float(np.mean(whole)), min(vehicles)


def collisions(built: BuiltScenario, seconds: float, folder: Path) -> tuple[int, float]:
    """Run plain SUMO with its collision check; return pairs that collided, and hours driven."""
    files = built.traffic_files(FULL)
    options = sumo_options(files, 0, 0.1)
    options[options.index("--collision.action") + 1] = "warn"
    sumo = Path(find_spec("sumo").origin).parent / "bin" / "sumo"
    collided, summary = folder / "collisions.xml", folder / "summary.xml"
    more = ["--end", files.warm_up + seconds, "--collision-output", collided, "--summary-output", summary]
    subprocess.run([sumo, *options, *map(str, more)], check=True, capture_output=True)
    pairs = {
        (each.get("collider"), each.get("victim")) for each in ElementTree.parse(collided).iter("collision")
    }
    running = sum(int(step.get("running", 0)) for step in ElementTree.parse(summary).iter("step"))
    return len(pairs), running * 0.1 / 3600


@pytest.mark.parametrize(
    "name", [each for each in nightly_but("loop") if getattr(each, "values", None) != ("city",)]
)
def test_has_dense_traffic_from_the_start(name):
    at_start, around_egos, _ = density(build_scenario(name), episodes=8)
    least = LEAST_AROUND_EGOS.get(name, LEAST_ELSEWHERE)
    assert around_egos >= least
    assert at_start >= 0.75 * least


@pytest.mark.parametrize("name", nightly_but("roundabout"))
def test_traffic_flows_and_does_not_collide(name, tmp_path):
    built, speeds, longest = build_scenario(name), [], 0.0
    with traffic_run(built, FULL, seed=0) as run:
        standing, generation = np.zeros(run.states.capacity), run.states.generation.copy()
        for states in run.steps(300.0):
            waits = states.alive & (states.speed < 0.1) & (states.kind != VehicleKind.BUS)
            standing = np.where(waits & (generation == states.generation), standing + run.dt, 0.0)
            generation, longest = states.generation.copy(), max(longest, standing.max())
            speeds.append(states.speed[states.alive].mean())
    assert np.mean(speeds) > 4.0
    assert np.mean(speeds[-600:]) > 3.0
    assert longest < LONGEST_STAND
    # At signals, some drivers run red lights, as in the paper's listing.
    found, vehicle_hours = collisions(built, 300.0, tmp_path)
    assert found <= (0.5 * vehicle_hours if name == "city" else 0)
