"""Traffic without agents equals SUMO's own, independent of other simulations in the process."""

import hashlib
import math
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path

import libsumo
import numpy as np
import pytest
import sumo

from smarts.errors import TrafficError
from smarts.providers.sumo_traffic import SumoTraffic, sumo_options
from smarts.types.traffic import Signal, TrafficFiles
from smarts.types.vehicles import Owner, VehicleKind
from smarts.types.world import World as State
from tests.raising import raises

from .conftest import BUSY_ROAD, front_of

ONE_CAR = '<vehicle id="a" depart="0" departPos="100" departSpeed="10"><route edges="ab bc"/></vehicle>'


def digest(world, files, seed, steps):
    """Return the hash of all states of an episode."""
    world.clear()
    world.reset(files, seed)
    hashed = hashlib.blake2b(world.fingerprint())
    for _ in range(steps):
        world.step()
        hashed.update(world.fingerprint())
    return hashed.hexdigest()


@pytest.mark.parametrize(("place", "warm_up"), [("road", 0.0), ("cross", 30.0)])
def test_equals_bare_libsumo_exactly(world, country, place, warm_up):
    files = getattr(country, place)(warm_up=warm_up)
    world.reset(files, seed=7)
    libsumo.start(["sumo", *sumo_options(files, 7, 0.1)])
    for _ in range(round(warm_up / 0.1)):
        libsumo.simulationStep()
    seen = 0
    for _ in range(600):
        world.step()
        libsumo.simulationStep()
        names = libsumo.vehicle.getIDList()
        assert sorted(world.names()) == sorted(names)
        rows = [world.slot(name) for name in names]
        if rows:
            angle = np.array([libsumo.vehicle.getAngle(name) for name in names])
            assert (world.states.speed[rows] == [libsumo.vehicle.getSpeed(name) for name in names]).all()
            acceleration = [libsumo.vehicle.getAcceleration(name) for name in names]
            assert (world.states.acceleration[rows] == acceleration).all()
            turn = np.degrees(world.states.heading[rows]) + angle - 90
            assert np.abs((turn + 180) % 360 - 180).max() < 1e-10
            position = np.array([libsumo.vehicle.getPosition(name) for name in names])
            assert np.abs(front_of(world.states, rows) - position).max() < 1e-12
            desired = [libsumo.vehicle.getAllowedSpeed(name) for name in names]
            assert (world.states.desired_speed[rows] == desired).all()
            seen += len(rows)
    libsumo.close()
    assert seen > 3000


@pytest.mark.parametrize(
    ("reaction_time", "dt", "is_ballistic"),
    [(0.0, 0.1, "false"), (0.19, 0.1, "false"), (0.2, 0.1, "true"), (1.0, 1.0, "false")],
)
def test_the_integration_is_named_and_is_the_one_that_sumo_chooses(
    country, tmp_path, reaction_time, dt, is_ballistic
):
    files = country.road()
    late = f'<routes><vType id="late" actionStepLength="{reaction_time}"/>' if reaction_time else "<routes>"
    routes = tmp_path / "late.rou.xml"
    routes.write_text(files.routes[0].read_text().replace("<routes>", late))
    options = sumo_options(replace(files, routes=(routes,), reaction_time=reaction_time), 7, dt)
    place = options.index("--step-method.ballistic")
    assert options[place + 1] == is_ballistic
    found = []
    for each in (options, [*options[:place], *options[place + 2 :]]):
        libsumo.start(["sumo", *each])
        for _ in range(round(30.0 / dt)):
            libsumo.simulationStep()
        found.append({name: libsumo.vehicle.getPosition(name) for name in libsumo.vehicle.getIDList()})
        libsumo.close()
    assert found[0] == found[1]
    assert len(found[0]) > 1


def test_equals_the_sumo_binary(world, country, tmp_path):
    files = country.cross()
    output = tmp_path / "fcd.xml"
    binary = Path(sumo.__file__).parent / "bin" / "sumo"
    options = ["--fcd-output", output, "--precision", "17", "--fcd-output.acceleration", "--end", "60"]
    subprocess.run([*map(str, [binary, *sumo_options(files, 5, 0.1), *options])], check=True)
    world.reset(files, seed=5)
    for moment in ElementTree.parse(output).getroot()[:600]:
        world.step()
        expected = {vehicle.attrib["id"]: vehicle.attrib for vehicle in moment}
        assert sorted(expected) == sorted(world.names())
        for slot in np.flatnonzero(world.states.alive):
            attributes = expected[world.registry.name(0, slot)]
            front = front_of(world.states, [slot])[0]
            assert front == pytest.approx([float(attributes["x"]), float(attributes["y"])], rel=0, abs=1e-12)
            assert world.states.speed[slot] == pytest.approx(float(attributes["speed"]), rel=0, abs=1e-12)


def test_interleaved_simulations_equal_separate_ones(new_world, country):
    files, steps = country.road(warm_up=10.0), 200
    alone = [digest(new_world(), files, seed, steps) for seed in range(3)]
    worlds = [new_world() for _ in range(3)]
    for seed, world in enumerate(worlds):
        world.reset(files, seed)
    hashes = [hashlib.blake2b(world.fingerprint()) for world in worlds]
    for _ in range(steps):
        for world, hashed in zip(worlds, hashes, strict=True):
            world.step()
            hashed.update(world.fingerprint())
    assert [hashed.hexdigest() for hashed in hashes] == alone
    assert len(set(alone)) == 3


def test_an_episode_does_not_depend_on_earlier_episodes(new_world, country):
    files = country.cross(warm_up=5.0)
    used = new_world()
    for seed in (1, 2):
        digest(used, country.road(), seed, 200)
    assert digest(used, files, 9, 300) == digest(new_world(), files, 9, 300)


IN_A_PROCESS = """
import sys
sys.path.insert(0, sys.argv[1])
from pathlib import Path
from tests.unit.providers.conftest import Country, World
from tests.unit.providers.test_sumo_traffic import digest
from smarts.types.traffic import TrafficFiles

world = World(Country(Path(sys.argv[2]).parent))
print(digest(world, TrafficFiles(Path(sys.argv[2]), (Path(sys.argv[3]),), (), 10.0), 11, 300))
"""


@pytest.mark.slow
def test_two_processes_agree(world, country):
    files = country.road(warm_up=10.0)
    root = Path(__file__).resolve().parents[3]
    command = [sys.executable, "-c", IN_A_PROCESS, root, files.net, files.routes[0]]
    printed = subprocess.run(
        [*map(str, command)], check=True, capture_output=True, text=True, cwd=root
    ).stdout
    assert printed.strip() == digest(world, files, 11, 300)


def test_a_row_in_detail(world, country):
    car = (
        '<vType id="bus" vClass="bus" length="12" width="2.5" speedFactor="1.1" speedDev="0" maxSpeed="30"/>'
        '<vehicle id="x" type="bus" depart="0" departPos="50" departSpeed="10" departLane="0">'
        '<route edges="wc ce"/></vehicle>'
    )
    world.reset(country.cross(car))
    assert not world.states.alive.any()
    world.step()
    states, row = world.states, world.slot("x")
    assert row == 0
    assert (states.owner[row], states.kind[row]) == (Owner.TRAFFIC, VehicleKind.BUS)
    assert (states.length[row], states.width[row]) == (12.0, 2.5)
    assert states.position[row] == pytest.approx([-200 + 50 - 6, -1.6])
    assert states.heading[row] == pytest.approx(0.0)
    assert states.lane[row] == -1  # the simulation matches all vehicles to lanes
    assert states.desired_speed[row] == pytest.approx(1.1 * 15)
    world.step()
    assert states.acceleration[row] == pytest.approx((states.speed[row] - 10.0) / 0.1)


def test_yaw_rate_and_lateral_speed_follow_from_the_poses(world, country):
    """A left turn from west to north is a quarter circle without slip; values are 0 before and after."""
    world.reset(country.cross('<vehicle id="x" depart="0" departPos="150"><route edges="wc cn"/></vehicle>'))
    world.step()
    states, slot = world.states, world.slot("x")
    columns = ("yaw_rate", "lateral_speed", "lateral_acceleration", "yaw_acceleration")
    for column in columns:
        getattr(states, column)[slot] = 9.0  # left by an earlier vehicle of the slot
    turned, greatest = 0.0, 0.0
    while abs(states.heading[slot] - math.pi / 2) > 1e-6 or turned == 0.0:
        world.step()
        turned += states.yaw_rate[slot] * 0.1
        greatest = max(greatest, states.yaw_rate[slot])
        assert states.lateral_acceleration[slot] == pytest.approx(states.speed[slot] * states.yaw_rate[slot])
        assert abs(states.lateral_speed[slot]) < 0.6
    assert turned == pytest.approx(math.pi / 2, abs=1e-6)
    assert greatest > 0.3
    world.step(2)
    assert [getattr(states, column)[slot] for column in columns] == pytest.approx([0.0] * 4, abs=1e-9)


def test_arrivals_have_no_yaw_rate(world, country):
    """The slot of an arrival may hold the pose of an earlier vehicle."""
    world.states.yaw_rate[:] = world.states.lateral_speed[:] = 9.0
    world.reset(country.road('<vehicle id="x" depart="0.1"><route edges="ba"/></vehicle>'))
    world.step(2)
    assert (world.states.yaw_rate[world.slot("x")], world.states.lateral_speed[world.slot("x")]) == (0.0, 0.0)


def test_slots_follow_the_order_of_departure_and_are_reused(world, country):
    cars = "".join(
        f'<vehicle id="{name}" depart="{when}" departSpeed="max"><route edges="{edges}"/></vehicle>'
        for name, when, edges in (("z", 0, "wc"), ("y", 3, "wc ce"), ("b", 9, "ec cw"), ("a", 30, "wc"))
    )
    world.reset(country.cross(cars, warm_up=10.0))
    assert [world.slot(name) for name in "zyb"] == [0, 1, 2]
    world.step(150)
    assert "z" not in world.names()
    assert world.states.generation[0] == 1
    world.step(100)
    assert world.slot("a") == 0
    assert world.states.generation[0] == 2


def test_a_full_world_delays_departures(new_world, country):
    world = new_world(capacity=10)
    world.reset(country.road(), limit=8)
    for _ in range(600):
        world.step()
        assert world.states.alive.sum() <= 8
    assert world.traffic.is_full


def test_the_last_free_slot_may_go_to_an_ego(new_world, country):
    """This holds even if another vehicle departs in SUMO in the same step."""
    world = new_world(capacity=8)
    world.reset(country.road(BUSY_ROAD.replace('vehsPerHour="700"', 'vehsPerHour="3000"')))
    entered = 0
    for step in range(600):
        if step % 25 == 0:
            for slot in np.flatnonzero(world.states.owner == Owner.AGENT).tolist():
                world.registry.dismiss(0, slot)
        if world.states.alive.sum() == 7:
            world.admit(900.0, 30.0, 0.0, 0.0)
            entered += 1
        world.step()
    assert entered > 10
    assert world.traffic.is_full


@pytest.mark.parametrize(
    ("kind", "shown"), [("traffic_light", "ryGg"), ("traffic_light_right_on_red", "ryGgs")]
)
def test_signals_are_those_of_the_lanes(world, country, kind, shown):
    files = country.cross(kind=kind)
    world.reset(files)
    libsumo.start(["sumo", *sumo_options(files, 3, 0.1)])
    seen = set()
    light_of = {"r": Signal.STOP, "y": Signal.CAUTION, "s": Signal.CAUTION, "g": Signal.GO, "G": Signal.GO}
    controlled = libsumo.trafficlight.getControlledLinks("c")
    for _ in range(700):
        libsumo.simulationStep()
        world.step()
        lights = libsumo.trafficlight.getRedYellowGreenState("c")
        for link, light in zip(controlled, lights, strict=True):
            lane = world.roads.lane_of_id(link[0][2])
            assert world.state.signals[0, lane] == light_of[light]
            seen.add(light)
    libsumo.close()
    assert seen == set(shown)
    road = world.roads.lane_of_id("wc_0")
    assert world.state.signals[0, road] == Signal.NONE


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (
            lambda files: files.net.write_text(files.net.read_text().replace("</net>", "")),
            "input ended before all started tags",
        ),
        (lambda files: files.routes[0].write_text('<routes><flow id="a" from="ab"/></routes>'), "flow 'a'"),
        (lambda files: files.routes[0].unlink(), "not accessible"),
    ],
)
def test_a_failed_start_is_one_named_error(new_world, country, tmp_path, damage, message):
    sound = country.road()
    broken = TrafficFiles(tmp_path / "map.net.xml", (tmp_path / "x.rou.xml",))
    broken.net.write_bytes(sound.net.read_bytes())
    broken.routes[0].write_bytes(sound.routes[0].read_bytes())
    damage(broken)
    neighbour, world = new_world(), new_world()
    expected = digest(new_world(), sound, 4, 100)
    neighbour.reset(sound, 4)
    hashed = hashlib.blake2b(neighbour.fingerprint())
    country_roads = country.roads(sound)
    with pytest.raises(TrafficError, match=message) as caught:
        world.traffic.reset(broken, 4, country_roads)
    assert "/proc/" not in str(caught.value), "errors must name files, not descriptors"
    for _ in range(100):
        neighbour.step()
        hashed.update(neighbour.fingerprint())
    assert hashed.hexdigest() == expected
    assert digest(world, sound, 4, 100) == expected


def test_a_failure_in_mid_run_is_one_named_error(new_world, country):
    late = (
        '<vehicle id="fine" depart="0"><route edges="ab bc"/></vehicle>'
        '<vehicle id="broken" depart="300"><route edges="bc ab"/></vehicle>'
    )
    neighbour, world = new_world(), new_world()
    world.reset(country.road(late))
    neighbour.reset(country.road())
    with raises(TrafficError, values=["broken"]):
        world.step(4000)
    neighbour.step(100)
    assert digest(world, country.road(), 4, 100) == digest(neighbour, country.road(), 4, 100)


def test_sumo_options():
    """The tests of equality with SUMO cannot check options, since both sides get the same."""
    files = TrafficFiles(Path("a.net.xml"), (Path("b.rou.xml"), Path("c.rou.xml")), (Path("d.add.xml"),))
    options = sumo_options(files, 7, 0.1)
    pairs = dict(zip(options[::2], options[1::2], strict=False))
    assert pairs["--net-file"] == "a.net.xml"
    assert pairs["--route-files"] == "b.rou.xml,c.rou.xml"
    assert pairs["--additional-files"] == "d.add.xml"
    assert pairs["--seed"] == "7"
    assert pairs["--step-length"] == "0.1"
    assert pairs["--lanechange.duration"] == "3"
    assert pairs["--time-to-teleport"] == "-1"
    assert pairs["--collision.action"] == "none"
    assert pairs["--collision.check-junctions"] == "true"


def test_a_step_is_a_whole_number_of_milliseconds():
    state = State(worlds=1, capacity=1, agents=0, lanes=1, dt=1 / 60)
    with raises(TrafficError, "dt"):
        SumoTraffic(state, 0)
