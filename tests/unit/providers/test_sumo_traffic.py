"""Traffic without agents equals SUMO's own, independent of other simulations in the process."""

import hashlib
import math
from dataclasses import replace

import libsumo
import numpy as np
import pytest

from smarts.errors import TrafficError
from smarts.providers.sumo_traffic import sumo_options
from smarts.types.traffic import Signal
from smarts.types.vehicles import Owner, VehicleKind
from tests.raising import raises

from .conftest import BUSY_ROAD


def digest(world, files, seed, steps):
    """Return the hash of all states of an episode."""
    world.clear()
    world.reset(files, seed)
    hashed = hashlib.blake2b(world.fingerprint())
    for _ in range(steps):
        world.step()
        hashed.update(world.fingerprint())
    return hashed.hexdigest()


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


def test_signals_are_those_of_the_lanes(world, country):
    files = country.cross(kind="traffic_light_right_on_red")
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
    assert seen == set("ryGgs")
    road = world.roads.lane_of_id("wc_0")
    assert world.state.signals[0, road] == Signal.NONE


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("<routes>", "input ended before all started tags"),
        ('<routes><flow id="a" from="ab"/></routes>', "flow 'a'"),
    ],
)
def test_a_failed_start_is_one_named_error(new_world, country, tmp_path, content, message):
    sound = country.road()
    broken = replace(sound, routes=(tmp_path / "x.rou.xml",))
    broken.routes[0].write_text(content)
    world = new_world()
    with pytest.raises(TrafficError, match=message) as caught:
        world.traffic.reset(broken, 4, country.roads(sound))
    assert "/proc/" not in str(caught.value), "errors must name files, not descriptors"
    assert digest(world, sound, 4, 100) == digest(new_world(), sound, 4, 100)


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
