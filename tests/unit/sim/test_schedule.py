"""The schedule: everything is reached, and an episode depends on seed, world and episode alone."""

import shutil
from dataclasses import replace

import pytest

from smarts.errors import ScenarioError
from smarts.roads.lane_graph import LaneGraph
from smarts.sim.schedule import Schedule, vehicle_limit
from smarts.sstudio.build import build_scenario
from tests.raising import raises


@pytest.fixture(scope="module")
def scenarios():
    return [build_scenario(name) for name in ("intersection", "two_way", "loop")]


def played(start):
    return (
        start.scenario,
        start.traffic_name,
        tuple(agent_id.mission.goal_position for agent_id in start.agents),
    )


def described(combination):
    return combination.built.name, combination.plan.traffic, combination.plan.missions


@pytest.mark.parametrize("egos", [1, 4])
def test_every_round_reaches_every_traffic_and_every_mission(scenarios, egos):
    schedule = Schedule(scenarios, [f"ego-{number}" for number in range(egos)])
    count = len(schedule.combinations)
    for world in (0, 3):
        for first in (0, count):
            reached = {described(schedule.combination(world, first + place)) for place in range(count)}
            assert reached == {described(combination) for combination in schedule.combinations}
    reached = {mission for combination in schedule.combinations for mission in combination.plan.missions}
    assert reached == {mission for built in scenarios for mission in built.scenario.ego_missions}
    traffic = {(built.name, name) for built in scenarios for name in built.scenario.traffic}
    assert {(each.built.name, each.plan.traffic) for each in schedule.combinations} == traffic


def test_worlds_and_rounds_have_orders_of_their_own(scenarios):
    schedule = Schedule(scenarios, ["ego"])
    count = len(schedule.combinations)
    orders = {
        tuple(played(schedule.start(world, first + place))[:2] for place in range(count))
        for world in range(3)
        for first in (0, count)
    }
    assert len(orders) == 6


def test_an_episode_is_a_function_of_seed_world_and_number(scenarios):
    one, other = Schedule(scenarios, ["a", "b"]), Schedule(scenarios, ["a", "b"])
    other.start(0, 0)
    assert one.start(2, 7) == other.start(2, 7)
    assert one.start(2, 7, seed=1) == Schedule(scenarios, ["a", "b"], seed=1).start(2, 7)
    starts = [one.start(world, episode) for world in range(2) for episode in range(24)]
    assert len({start.traffic_seed for start in starts}) == len(starts)
    assert len({(start.agents[0].pose, start.agents[0].speed) for start in starts}) == len(starts)


def test_episodes_have_their_own_maps_where_more_are_played_than_stay_loaded(scenarios, monkeypatch):
    monkeypatch.setattr("smarts.sstudio.built._load_roads", LaneGraph.load)
    schedule = Schedule([*scenarios, scenarios[0]], ["ego"])
    assert len(schedule.maps) == len(scenarios)
    for each in schedule.combinations:
        assert schedule.maps[each.map].edge_ids == each.built.roads().edge_ids


def test_maps_are_loaded_once(scenarios):
    schedule = Schedule([*scenarios, scenarios[0]], ["ego"])
    assert len(schedule.maps) == len(scenarios)
    for start in (schedule.start(0, episode) for episode in range(len(schedule.combinations))):
        name = start.scenario
        built = next(each for each in scenarios if each.name == name)
        assert schedule.maps[start.map] is built.roads()


def test_scenarios_of_one_name_are_refused(scenarios, tmp_path):
    folder = tmp_path / "other"
    shutil.copytree(scenarios[0].directory, folder)
    other = replace(scenarios[0], source=tmp_path, directory=folder)
    with raises(ScenarioError, tmp_path, values=[scenarios[0].name, scenarios[0].source]):
        Schedule([scenarios[0], other], ["ego"])
    Schedule([scenarios[0], scenarios[0]], ["ego"])


def test_the_limit_follows_from_the_map(scenarios):
    loop = next(built for built in scenarios if built.name == "loop")
    roads = loop.roads()
    assert vehicle_limit(loop) == pytest.approx(roads.length.sum() / 7.5, abs=1)
    schedule = Schedule(scenarios, ["a", "b"])
    assert schedule.limit == max(map(vehicle_limit, scenarios))
    limits = {start.scenario: start.limit for start in (schedule.start(0, n) for n in range(12))}
    assert limits == {built.name: vehicle_limit(built) + 2 for built in scenarios}


def test_scenarios_come_by_their_weights_whatever_they_have(scenarios):
    # The loop has many more sets of missions for one ego than the others have.
    weights, episodes = (3.0, 1.0, 2.0), 1200
    schedule = Schedule(scenarios, ["ego"], weights=weights)
    names = [schedule.combination(world, episode).built.name for world in range(4) for episode in range(300)]
    counts = [names.count(built.name) for built in scenarios]
    expected = [episodes * weight / sum(weights) for weight in weights]
    chi_square = sum((got - want) ** 2 / want for got, want in zip(counts, expected, strict=True))
    assert chi_square < 9.2  # the 99th percentile with two degrees of freedom
    played = {described(schedule.combination(world, 0)) for world in range(1000)}
    assert played == {described(each) for each in schedule.combinations}
    other = Schedule(scenarios, ["ego"], weights=weights)
    assert other.combination(3, 299).built.name == names[-1]


def test_weights_are_one_for_each_scenario(scenarios):
    with raises(ScenarioError, "weights", values=[2, 3]):
        Schedule(scenarios, ["ego"], weights=(1.0, 2.0))
