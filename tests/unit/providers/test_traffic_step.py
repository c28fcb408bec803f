"""SUMO in longer steps than the world's: SUMO's own poses at their ends, and a smooth way between them."""

import math
from functools import partial

import libsumo
import numpy as np
import pytest

from smarts.env.vector import VectorHiWayEnv
from smarts.errors import SmartsError
from smarts.providers.sumo_rows import lead, pose_between
from smarts.providers.sumo_traffic import sumo_options
from smarts.providers.traffic_engines import traffic_of
from smarts.sim.assembly import Options
from smarts.types.streams import Purpose, stream
from smarts.types.vehicles import Owner, VehicleKind

from .conftest import front_of

ONE_CAR = '<vehicle id="a" depart="0" departPos="100" departSpeed="10"><route edges="ab bc"/></vehicle>'


def motion(x, y, heading, speed):
    return np.array([x, y, heading, speed, 0.0, 20.0])


def test_between_two_poses_on_a_line_the_speed_changes_evenly():
    """From 10 to 6 m/s in 0.5 s: the way is 4 m, of which 2.25 m are behind after half of the time."""
    begin, end = motion(0.0, 0.0, 0.0, 10.0), motion(4.0, 0.0, 0.0, 6.0)
    x, y, heading, speed, *_ = pose_between(begin, end, 0.5)
    assert (x, y, heading, speed) == pytest.approx((2.25, 0.0, 0.0, 8.0))


def test_on_a_circle_the_way_is_the_arc():
    generator = stream(1, Purpose.STARTS)
    for _ in range(100):
        radius, speed = generator.uniform(6, 100), generator.uniform(1, 8)
        turn = generator.choice([-1, 1]) * 0.5 * speed / radius
        first = generator.uniform(-math.pi, math.pi)
        centre = -math.sin(first), math.cos(first)
        side = math.copysign(radius, turn)

        def on_arc(angle, centre=centre, side=side, speed=speed):
            x, y = side * (centre[0] + math.sin(angle)), side * (centre[1] - math.cos(angle))
            heading = (angle + math.pi) % (2 * math.pi) - math.pi
            return motion(x, y, heading, speed)

        for share in generator.uniform(0, 1, 3):
            x, y, heading, *_ = pose_between(on_arc(first), on_arc(first + turn), share)
            truth = on_arc(first + share * turn)
            assert math.hypot(x - truth[0], y - truth[1]) < 0.02
            assert math.cos(heading - truth[2]) > math.cos(0.01)


def test_at_the_ends_of_its_steps_all_is_as_in_bare_sumo(new_world, country):
    world, files = new_world(step=0.5), country.cross(warm_up=10.0)
    world.reset(files, seed=7)
    libsumo.start(["sumo", *sumo_options(files, 7, 0.5)])
    libsumo.simulation.step(10.0)
    seen = 0
    for step in range(1, 601):
        world.step()
        if step % 5:
            continue
        libsumo.simulationStep()
        names = libsumo.vehicle.getIDList()
        assert sorted(world.names()) == sorted(names)
        rows = [world.slot(name) for name in names]
        fronts = [front_of(world.states, row) for row in rows]
        np.testing.assert_allclose(fronts, [libsumo.vehicle.getPosition(name) for name in names], atol=1e-9)
        assert (world.states.speed[rows] == [libsumo.vehicle.getSpeed(name) for name in names]).all()
        seen += len(rows)
    libsumo.close()
    assert seen > 500


def test_within_a_step_vehicles_move_and_do_not_jump(new_world, country):
    world = new_world(step=0.5)
    world.reset(country.cross(warm_up=10.0), seed=7)
    states, moved = world.states, 0
    for _ in range(600):
        before, generation = states.position.copy(), states.generation.copy()
        was, speed = states.alive.copy(), states.speed.copy()
        world.step()
        stays = was & states.alive & (generation == states.generation)
        way = np.hypot(*(states.position - before).T)[stays]
        fastest = np.maximum(speed, states.speed)[stays]
        # A vehicle that has just departed stands until SUMO's step is over.
        assert (way <= 0.1 * fastest + 0.25).all()
        moved += int((way > 0.05).sum())
        assert np.abs(states.yaw_rate[stays]).max(initial=0.0) < 3.0
    assert moved > 3000


def test_a_slot_that_is_given_away_within_a_step_is_left_alone(new_world, country):
    world = new_world(step=0.5)
    world.reset(country.road(ONE_CAR))
    world.step(11)
    slot = world.slot("a")
    world.registry.dismiss(0, slot)
    other = world.registry.admit(0, "ego", Owner.AGENT, VehicleKind.PASSENGER, 5.0, 1.8)
    assert other == slot
    world.put(slot, 400.0, -1.6, 0.0, 0.0)
    world.step(9)
    assert world.states.position[slot].tolist() == [400.0, -1.6]
    assert world.names() == ["ego"]
    assert world.traffic._library.vehicle.getIDList() == (world.traffic._ids[slot],), "SUMO has the new one"


def test_a_turning_vehicle_is_predicted_on_its_circle(new_world):
    states = new_world().states
    states.heading[0], states.speed[0], states.yaw_rate[0] = 0.3, 5.0, 0.5
    (now,), (then,) = lead(states, np.array([0]), 0.0), lead(states, np.array([0]), 0.4)
    assert now[:2].tolist() == [0.0, 0.0]
    radius, turn = 10.0, 0.3 + 0.4 * 0.5
    truth = radius * (math.sin(turn) - math.sin(0.3)), radius * (math.cos(0.3) - math.cos(turn))
    assert then[:2] == pytest.approx(truth, abs=0.01)
    assert then[3] == pytest.approx(turn)


def refused(place, call, *args, **more):
    with pytest.raises(SmartsError) as error:
        call(*args, **more)
    assert place in error.value.place


def test_what_a_longer_step_does_not_go_with(new_world, tmp_path):
    for step in (0.25, 1.1, 0.0):
        refused("Options", Options, traffic_step=step)
    refused("Options.traffic_step", Options, traffic_step=0.5, record=tmp_path)
    refused("traffic_step", traffic_of, ["Native"], new_world().state, [], step=0.5)
    made = partial(VectorHiWayEnv, simulation=Options(traffic_step=0.5))
    refused("left_turn_bubble", made, 1, ["examples/left_turn_bubble"], 1)
    social = [{"agent": "smarts.zoo:idm-v0"}]
    refused("Options.traffic_step", made, 1, ["intersection"], 1, social_agents=social)
