"""Gates: what each of them refuses, in cases computed by hand."""

import math

import numpy as np
import pytest

from smarts.providers.gates import chord_pose, compare_with_chord, find_too_close
from smarts.types.transfers import Refusal
from smarts.types.vehicles import Owner, VehicleStates

from .conftest import streets
from .test_sumo_shadows import RIGHT, begin, drivers, from_arm, sumo_motion

QUARTER = np.linspace(0.0, math.pi / 2, 400)
"""Angles of a quarter circle."""


def two_cars(dx, dy, speed=0.0, other_speed=0.0, turned=0.0):
    """Return two cars of 5 x 2 m: the first at the origin, facing east."""
    states = VehicleStates.allocate(1, 3)
    for slot, (x, y, heading, v) in enumerate([(0.0, 0.0, 0.0, speed), (dx, dy, turned, other_speed)]):
        states.alive[0, slot] = True
        states.position[0, slot] = x, y
        states.heading[0, slot], states.speed[0, slot] = heading, v
        states.length[0, slot], states.width[0, slot] = 5.0, 2.0
    return states


@pytest.mark.parametrize(
    ("case", "is_near"),
    [
        (two_cars(5.29, 0.0), True),
        (two_cars(5.31, 0.0), False),
        (two_cars(0.0, 2.29), True),
        (two_cars(0.0, 2.31), False),
        (two_cars(6.2, 0.0, speed=5.0), True),  # 1.2 m apart, 0.2 m after 0.2 s
        (two_cars(6.4, 0.0, speed=5.0), False),
        (two_cars(6.2, 0.0, speed=5.0, other_speed=5.0), False),
        (two_cars(3.79, 0.0, turned=math.pi / 2), True),  # across: 2.5 m + 1 m
        (two_cars(3.81, 0.0, turned=math.pi / 2), False),
    ],
)
def test_vehicles_nearer_than_a_distance_are_too_close(case, is_near):
    found = np.zeros(1, np.bool_)
    find_too_close(case, np.zeros(1, np.int32), np.zeros(1, np.int32), 0.3, 0.2, found)
    assert found[0] == is_near


def test_both_ends_of_a_vehicle_are_on_its_line():
    """On a circle of 20 m, the middle of a chord of 12 m is sqrt(20^2 - 6^2) m from the circle's centre."""
    xy = 20.0 * np.column_stack([np.cos(QUARTER), np.sin(QUARTER)])
    s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(xy, axis=0).T))])
    reach = 2 * 20.0 * math.asin(6.0 / 20.0)  # arc over the chord
    x, y, heading = chord_pose(xy, s, 0, len(xy), reach, reach, 0.0)
    ends = np.array([[20.0, 0.0], [20.0 * math.cos(reach / 20), 20.0 * math.sin(reach / 20)]])
    along = ends[1] - ends[0]
    assert heading == pytest.approx(math.atan2(along[1], along[0]), abs=1e-4)
    # The vehicle is as long as the arc, so its centre is half an arc behind its front.
    assert [x, y] == pytest.approx(ends[1] - 0.5 * reach * along / 12.0, abs=1e-3)


def test_a_pose_is_compared_now_and_after_the_next_step():
    """The car's front is 25 m along a straight line; offset and heading differ, then the yaw rate does."""
    states = two_cars(50.0, 0.0, speed=10.0)
    line, stations = np.array([[-22.5, 0.0], [77.5, 0.0]]), np.array([0.0, 100.0])

    def compare():
        return compare_with_chord(states, 0, line, stations, 0, 0, 2, 25.0, 0.0, 0.1)

    assert compare() == pytest.approx((0.0, 0.0), abs=1e-12)
    states.position[0, 0, 1] = 0.07
    assert compare() == pytest.approx((0.0, 0.07), abs=1e-12)
    states.position[0, 0, 1], states.yaw_rate[0, 0] = 0.0, 0.3
    assert compare() == pytest.approx((0.03, math.sin(0.015)), abs=1e-9)
    states.heading[0, 0] = 0.02
    assert compare()[0] == pytest.approx(0.05, abs=1e-9)


def after(world, slot, x, y, heading=0.0, speed=10.0, steps=10):
    """Move an agent's vehicle straight to a pose; return the gate's answer there."""
    world.states.owner[slot] = Owner.AGENT
    for step in range(steps, -1, -1):
        back = 0.1 * speed * step
        world.put(slot, x - back * math.cos(heading), y - back * math.sin(heading), heading, speed)
        world.step()
    return world.traffic.can_accept(slot)


@pytest.mark.parametrize(
    ("x", "y", "heading", "refusal"),
    [
        (300.0, RIGHT, 0.0, Refusal.NONE),
        (300.0, RIGHT + 0.4, 0.0, Refusal.NONE),
        (300.0, RIGHT - 0.7, 0.0, Refusal.OFFSET),
        (300.0, RIGHT, 0.06, Refusal.NONE),
        (300.0, RIGHT, 0.12, Refusal.HEADING),
        (300.0, -40.0, 0.0, Refusal.OFF_LANES),
        (996.9, RIGHT, 0.0, Refusal.IN_JUNCTION),  # 0.6 m before it, at 10 m/s
    ],
)
def test_sumo_takes_a_vehicle_where_it_would_show_it(world, country, x, y, heading, refusal):
    begin(world, country.road(drivers((0, 100, 10))), 3.0)
    assert after(world, world.slot("s0"), x, y, heading) == refusal


def test_an_overlap_is_too_close(world, country):
    begin(world, country.road(drivers((0, 100, 0), (0, 60, 10))), 3.0)
    slot, other = world.slot("s1"), world.slot("s0")
    x, y = world.states.position[other]
    world.states.owner[other] = Owner.AGENT
    assert after(world, slot, float(x) - 4.9, float(y), speed=1.0) == Refusal.TOO_CLOSE


@pytest.mark.parametrize(("gap", "refusal"), [(4.0, Refusal.SPEED), (60.0, Refusal.NONE)])
def test_a_vehicle_that_would_have_to_brake_hard_is_refused(world, country, gap, refusal):
    """A standing vehicle is ahead: at 15 m/s, 4 m are too short, 60 m are enough."""
    begin(world, country.road(drivers((0, 100, 10))), 3.0)
    standing = world.admit(500.0, RIGHT, 0.0, 0.0)
    assert after(world, world.slot("s0"), 500.0 - 5.0 - gap, RIGHT, speed=15.0) == refusal
    assert world.states.alive[standing]


def test_a_vehicle_does_not_stop_dead_where_its_lane_does_not_lead_on(world, country):
    """The right lane leads off the route 5 m ahead: without another way, SUMO halts the vehicle there."""
    nodes = {"a": (0, 0), "b": (500, 0), "c": (1000, 0), "d": (500, -200)}
    edges = {edge: f'numLanes="{lanes}" speed="20"' for edge, lanes in (("ab", 2), ("bc", 1), ("bd", 1))}
    net = country.net("exit", streets(nodes, edges))
    begin(world, country.files(net, drivers((1, 100, 13))), 0.3)
    slot, states = world.slot("s0"), world.states
    end = world.traffic._library.lane.getLength("ab_0")
    assert after(world, slot, end - 5.0 - 2.5, RIGHT, speed=13.0, steps=20) == Refusal.NONE
    states.owner[slot] = Owner.TRAFFIC
    speeds = [float(states.speed[slot])]
    for _ in range(10):
        world.step()
        speeds.append(float(states.speed[slot]))
    assert -np.diff(speeds).min() < 0.46
    assert world.route(slot) == ("ab", "bd")


@pytest.mark.parametrize(("offset", "heading"), [(-0.35, 0.0), (0.1, 0.07)])
def test_what_is_left_of_the_pose_decays_without_a_jump(world, country, offset, heading):
    begin(world, country.road(drivers((0, 100, 10))), 3.0)
    slot, states = world.slot("s0"), world.states
    assert after(world, slot, 300.0, RIGHT + offset, heading) == Refusal.NONE
    states.owner[slot] = Owner.TRAFFIC
    aside, turns = [offset], [heading]
    for _ in range(20):
        y, ahead = float(states.position[slot, 1]), 0.1 * float(states.speed[slot])
        world.step()
        aside.append(float(states.position[slot, 1]) - RIGHT)
        turns.append(float(states.heading[slot]))
        moved = float(states.position[slot, 1]) - y
        assert states.yaw_rate[slot] == pytest.approx((turns[-1] - turns[-2]) / 0.1, abs=1e-6)
        along = ahead * math.sin(turns[-1] - 0.5 * (turns[-1] - turns[-2]))
        assert 0.1 * states.lateral_speed[slot] == pytest.approx(moved - along, abs=0.02)
    steady = 0.1 * 10.0 * math.sin(heading)
    assert aside[1] - aside[0] == pytest.approx(steady, abs=0.08)
    assert np.abs(np.diff(aside[1:])).max() < 0.08
    assert np.abs(np.diff(turns)).max() < 0.02
    assert aside[-1] == pytest.approx(0.0, abs=1e-6)
    assert turns[-1] == pytest.approx(0.0, abs=1e-6)


BUS = 'vClass="bus" length="12"'


@pytest.mark.parametrize(
    ("kind", "arm", "to", "front", "refusal"),
    [
        ("", "w", "e", -15.0, Refusal.NONE),  # the main road has priority
        ("", "s", "n", -30.0, Refusal.NONE),  # 8 m/s: it needs 0.8 m and 8^2 / (2 * 4.5) m = 7.1 m to stop
        ("", "s", "n", -13.0, Refusal.WITHOUT_PRIORITY),
        ("", "s", "n", 20.0, Refusal.NONE),
        ("", "w", "n", 0.0, Refusal.WITHOUT_PRIORITY),  # a left turn across the oncoming lane
        (BUS, "w", "s", -45.0, Refusal.TIGHT_TURN),  # a bus turns around 15 m, the lane around 6 m
        (BUS, "w", "s", 30.0, Refusal.NONE),
        (BUS, "w", "e", -45.0, Refusal.NONE),
        ("", "w", "s", -45.0, Refusal.NONE),
    ],
)
def test_sumo_keeps_a_vehicle_that_crosses_without_priority_or_turns_too_tightly(
    world, country, kind, arm, to, front, refusal
):
    """The vehicle is alone, so SUMO lets it cross without a stop."""
    routes = from_arm(arm, to, 150, 8).replace('id="calm"', f'id="calm" {kind} maxSpeed="8"')
    begin(world, country.cross(routes))
    slot, states = world.slot("s0"), world.states
    answer, gone = Refusal.NONE, -52.0
    while gone < front:  # along its way, from the middle of the junction
        world.step()
        gone += 0.1 * float(states.speed[slot])
        answer = world.traffic.can_release(slot)
    assert answer == refusal


def both_ways(pairs, more):
    """Return edges both ways between the ends of each pair, with further attributes."""
    return {edge: more for pair in pairs.split() for edge in (pair, pair[::-1])}


def two_junctions(country, gap, main=1, side=0, **kinds):
    """Return a road to the east across x = 0 m and, where another road has priority, x = `gap` [m].

    Args:
        country: Compiles the net.
        gap: [m]
        main: Priority of the road.
        side: Priority of the road that joins it at x = 0 m.
        kinds: SUMO's types of junctions.
    """
    nodes = {"a": (-300, 0), "b": (0, 0), "c": (gap, 0), "d": (300, 0), "e": (0, 200)}
    nodes |= {"n": (gap, 200), "s": (gap, -200)}
    edges = {
        edge: more
        for pairs, rank in (("ab bc cd", main), ("be", side), ("nc cs", 5))
        for edge, more in both_ways(pairs, f'speed="30" priority="{rank}"').items()
    }
    return country.net(f"two_junctions_{gap}_{main}_{side}", streets(nodes, edges, **kinds))


@pytest.mark.parametrize("gap", [14, 60])
def test_sumo_keeps_a_vehicle_in_a_junction_that_cannot_stop_before_the_next_one(world, country, gap):
    """An agent may have it as long as its front can stop, at 4.5 m/s^2 and after a step, before the line."""
    car = '<vType id="calm" maxSpeed="15" sigma="0"/>'
    trip = (
        '<vehicle id="s0" type="calm" depart="0" departPos="150" departSpeed="15"><route edges="ab bc cd"/>'
    )
    begin(world, country.files(two_junctions(country, gap), f"{car}{trip}</vehicle>"))
    slot, states = world.slot("s0"), world.states
    line = float(world.roads.centreline(world.roads.lane_of_id("bc_0"))[-1, 0])
    inside = []
    while (front := float(states.position[slot, 0]) + 2.5) < line:
        speed = float(states.speed[slot])
        needed = 0.1 * speed + speed**2 / 9.0
        if abs(line - front - needed) > 0.5:
            refusal = Refusal.WITHOUT_PRIORITY if line - front < needed else Refusal.NONE
            assert world.traffic.can_release(slot) == refusal, f"{front} m"
            if front > -9.0 and sumo_motion(world, slot)[0].startswith(":b"):
                inside.append(refusal)
        world.step()
    assert Refusal.NONE in inside if gap == 60 else Refusal.WITHOUT_PRIORITY in inside


@pytest.mark.parametrize(("priority", "refusal"), [(9, Refusal.NONE), (1, Refusal.SPEED)])
def test_sumo_takes_no_vehicle_that_it_would_brake_hard_for_the_junction_after_the_next(
    world, country, priority, refusal
):
    """At 25 m/s, 25^2 / (2 * 4.5) m = 69 m to stop; the line of the second junction is about 60 m ahead."""
    begin(world, country.files(two_junctions(country, 45, priority, priority, c="priority_stop"), ""))
    slot = world.admit(-55.0, -1.6, 0.0, 25.0)
    world.set_route(slot, ("ab", "bc", "cd"))
    assert after(world, slot, -30.0, -1.6, speed=25.0) == refusal


@pytest.mark.parametrize(("speed", "refusal"), [(12.0, Refusal.NONE), (3.0, Refusal.SIDEWAYS)])
def test_sumo_keeps_a_slow_vehicle_that_changes_lanes(world, country, speed, refusal):
    """A lane of 3.2 m in 3 s: it leans by 1.07 / 12 = 0.09 rad, or by 1.07 / 3 = 0.34 rad."""
    begin(world, country.road(drivers((0, 20, speed)).replace('id="calm"', f'id="calm" maxSpeed="{speed}"')))
    slot = world.slot("s0")
    world.traffic._library.vehicle.changeLane("s0", 1, 10.0)
    answers = []
    for _ in range(15):
        world.step()
        answers.append(world.traffic.can_release(slot))
    assert answers[-1] == refusal
    for _ in range(30):
        world.step()
    assert world.traffic.can_release(slot) == Refusal.NONE
