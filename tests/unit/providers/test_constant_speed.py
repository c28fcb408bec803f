"""The traffic engine ConstantSpeed, on a square track of 360 m or so."""

from pathlib import Path

import numpy as np
import pytest

from smarts.providers.constant_speed import ConstantSpeed
from smarts.types.episode import EpisodeStart
from smarts.types.traffic import TrafficFiles
from smarts.types.world import World
from tests.unit.sim.test_map_matching import ring

ALL = np.ones(1, np.bool_)
ROUTES = """<routes>
    <route id="round" edges="south east north west" {repeat}/>
    <vehicle id="car" route="round" depart="{depart}"/>
</routes>"""


@pytest.fixture(scope="module")
def track():
    return ring()


FLOW = """<routes>
    <route id="round" edges="south east north west"/>
    <flow id="cars" route="round" begin="-50" end="{end}" vehsPerHour="600"/>
</routes>"""


def driven(track, folder, *, repeat="", depart=0.0, warm_up=0.0):
    """Return a world with one vehicle, and its traffic."""
    return played(track, folder, ROUTES.format(repeat=repeat, depart=depart), warm_up)


def played(track, folder, routes, warm_up=0.0, limit=16):
    """Return a world and its traffic."""
    file = folder / "map.rou.xml"
    file.write_text(routes)
    world = World(worlds=1, capacity=limit, agents=1, lanes=len(track.lane_ids), egos=0)
    traffic = ConstantSpeed(world, [track])
    files = TrafficFiles(Path("map.net.xml"), (file,), warm_up=warm_up)
    world.clear(0)
    traffic.reset({0: EpisodeStart(1, 0, 0, "track", 0, files, None, 0, limit, ())})
    world.settle(0)
    return world, traffic


def way(world, traffic, steps):
    """Return the places of the vehicle after each step, as long as it is there."""
    found = []
    for _ in range(steps):
        world.advance(ALL)
        traffic.step(ALL)
        if not world.vehicles.alive.any():
            break
        found.append(world.vehicles.position[0, np.flatnonzero(world.vehicles.alive[0])[0]].copy())
    return np.array(found)


def test_a_vehicle_of_a_repeated_route_goes_round_again_without_a_jump(track, tmp_path):
    world, traffic = driven(track, tmp_path, repeat='repeat="500"')
    places = way(world, traffic, 1500)
    assert len(places) == 1500
    limit = float(track.speed_limit.min())
    assert np.hypot(*np.diff(places, axis=0).T).max() < 0.1 * limit + 0.01
    once = np.flatnonzero(np.hypot(*(places - places[0]).T) < 0.5 * limit * 0.1 + 0.01)
    assert len(once) >= 4, "at least three times round"
    route = world.routes.edges(0, int(world.vehicles.route[world.vehicles.alive][0]))
    assert [track.edge_ids[edge] for edge in route] == ["south", "east", "north", "west", "south"]


def test_a_vehicle_may_have_gone_round_in_the_warm_up(track, tmp_path):
    world, _ = driven(track, tmp_path, repeat='repeat="500"', warm_up=100.0)
    later, traffic = driven(track, tmp_path, repeat='repeat="500"')
    (expected,) = way(later, traffic, 1000)[-1:]
    np.testing.assert_allclose(world.vehicles.position[world.vehicles.alive][0], expected, atol=1e-6)


def test_a_flow_without_an_end_comes_at_its_rate_from_the_warm_up_on(track, tmp_path):
    world, traffic = played(track, tmp_path, FLOW.format(end=1e9))
    speed = world.vehicles.speed[world.vehicles.alive][0]
    along = np.sort(traffic._s[world.vehicles.alive])
    assert along[0] < 6 * speed
    assert along[-1] > traffic._paths.length[0] - 6 * speed
    np.testing.assert_allclose(np.diff(along), 6 * speed)
    came = []
    for step in range(1, 400):
        before = world.vehicles.generation.sum()
        world.advance(ALL)
        traffic.step(ALL)
        came += [step] * int(world.vehicles.generation.sum() - before)
    assert set(np.diff(came)) == {60}


def test_a_flow_ends_and_takes_nothing_from_others(track, tmp_path):
    world, traffic = played(track, tmp_path, FLOW.format(end=0.0))
    there = int(world.vehicles.alive.sum())
    assert there > 1
    assert len(traffic._flows) == 0
    for _ in range(200):
        world.advance(ALL)
        traffic.step(ALL)
    assert world.vehicles.alive.sum() < there


@pytest.mark.parametrize("warm_up", [0.0, 50.0])
def test_a_single_vehicle_departs_once(track, tmp_path, warm_up):
    """Times less the warm-up are rounded, such as 60.3 - 50."""
    departures = np.arange(max(0.1, warm_up - 1.0), warm_up + 2.0, 0.1)
    for depart in departures.round(1).tolist():
        world, traffic = driven(track, tmp_path, depart=depart, warm_up=warm_up)
        due, came = round(10 * (depart - warm_up)), []
        for _ in range(30):
            came.append(int(world.vehicles.generation.sum()))
            world.advance(ALL)
            traffic.step(ALL)
        assert came[-1] == 1, depart
        assert came.index(1) in ((0,) if due <= 0 else (due, due + 1)), depart


@pytest.mark.parametrize("repeat", ["", 'repeat="500"'])
@pytest.mark.parametrize("rates", [[800, 800], [3600, 3600]])
def test_the_warm_up_leaves_the_vehicles_that_steps_leave(track, tmp_path, rates, repeat):
    """Vehicles without room depart later, and only vehicles that have departed take room."""
    flow = "<flow id='{}' route='round' begin='0' end='9e3' vehsPerHour='{}'/>"
    flows = "".join(flow.format(number, rate) for number, rate in enumerate(rates))
    routes = f"<routes><route id='round' edges='south east north west' {repeat}/>{flows}</routes>"
    _, traffic = played(track, tmp_path, routes, 60.0, limit=40)
    expected, stepped = played(track, tmp_path, routes, limit=40)
    for _ in range(600):
        expected.advance(ALL)
        stepped.step(ALL)
    places, others = (np.sort(each._s[each._world.vehicles.alive]) for each in (traffic, stepped))
    assert len(places) > 11
    np.testing.assert_allclose(places, others, atol=0.1 * traffic._paths.speed[0] + 1e-6)
