"""Reactions of SUMO's drivers to shadows, with a case for every known pitfall of `moveToXY`."""

import math

import numpy as np
import pytest

from smarts.geometry.boxes import boxes_overlap

from .conftest import streets

RIGHT, LEFT = -4.8, -1.6
"""y of the two eastbound lanes of the road [m]."""

CALM = '<vType id="calm" sigma="0" speedFactor="1" speedDev="0" lcSpeedGain="0" lcKeepRight="0"/>'


def drivers(*starts):
    """Return routes of calm drivers "s0", "s1", ... on the road, from their (lane, position, speed)."""
    return CALM + "".join(
        f'<vehicle id="s{number}" type="calm" depart="0" departLane="{lane}" departPos="{position}" '
        f'departSpeed="{speed}"><route edges="ab bc"/></vehicle>'
        for number, (lane, position, speed) in enumerate(starts)
    )


def from_arm(arm, to, position=60, speed=10):
    return CALM + (
        f'<vehicle id="s0" type="calm" depart="0" departPos="{position}" departSpeed="{speed}">'
        f'<route edges="{arm}c c{to}"/></vehicle>'
    )


def drive(world, ego, motion, steps, start=0.0):
    """Move the ego by `motion(time) -> x, y, heading, speed`, and check that no vehicles touch."""
    for step in range(1, steps + 1):
        world.put(ego, *motion(start + step * 0.1))
        world.step()
        assert not touching(world), f"contact after {start + step * 0.1:.1f} s"


def touching(world):
    rows = np.flatnonzero(world.states.alive)
    position, heading = world.states.position[rows], world.states.heading[rows]
    size = np.stack([world.states.length[rows], world.states.width[rows]], -1)
    overlap = boxes_overlap(position[:, None], heading[:, None], size[:, None], position, heading, size)
    return bool(overlap[~np.eye(len(rows), dtype=bool)].any())


def sumo_motion(world, slot):
    """Return lane, speed and angle of a shadow in SUMO."""
    vehicle = world.traffic._library.vehicle
    name = world.traffic._ids[slot]
    return vehicle.getLaneID(name), vehicle.getSpeed(name), vehicle.getAngle(name)


def speed(world, name):
    return world.states.speed[world.slot(name)]


def x(world, name):
    return world.states.position[world.slot(name), 0]


def begin(world, files, seconds=0.1):
    world.reset(files)
    world.step(round(seconds / 0.1))


def test_a_driver_stops_behind_a_standing_ego(world, country):
    begin(world, country.road(drivers((0, 100, 10))))
    ego = world.admit(250.0, RIGHT, 0.0, 0.0)
    drive(world, ego, lambda t: (250.0, RIGHT, 0.0, 0.0), 200)
    # It stops with its minimum gap, 2.5 m, before the ego's rear.
    assert x(world, "s0") == pytest.approx(250 - 2.5 - 2.5 - 2.5, abs=0.5)


def test_a_shadow_has_the_pose_and_speed_of_its_vehicle(world, country):
    """The vehicle is faster than the limit and at an angle to the lane."""
    begin(world, country.road(drivers((0, 10, 10))))
    ego = world.admit(200.0, LEFT, 0.1, 33.0)
    vehicle = world.traffic._library.vehicle
    for step in range(1, 120):
        world.put(ego, 200 + 3.3 * step, LEFT, 0.1, 33.0)
        world.step()
        lane, shown_speed, angle = sumo_motion(world, ego)
        assert shown_speed == pytest.approx(33.0)
        assert angle == pytest.approx(90 - math.degrees(0.1))
        assert lane == "ab_1"
        front = 200 + 3.3 * step + 2.5 * math.cos(0.1), LEFT + 2.5 * math.sin(0.1)
        assert vehicle.getPosition(world.traffic._ids[ego]) == pytest.approx(front)


def test_overtaking_inside_a_lane_and_braking(world, country):
    """SUMO ignores an ego that has overtaken within a lane, unless it is re-inserted."""
    routes = drivers((0, 100, 10)).replace('id="calm"', 'id="calm" maxSpeed="10"')
    begin(world, country.road(routes))
    ego = world.admit(60.0, RIGHT, 0.0, 25.0)
    # The ego passes through the other vehicle; only the time afterwards is checked.
    for step in range(1, 51):
        world.put(ego, 60 + 2.5 * step, RIGHT, 0.0, 25.0)
        world.step()
    assert x(world, "s0") + 10 < 60 + 2.5 * 50
    drive(world, ego, lambda t: (185.0, RIGHT, 0.0, 0.0), 200)
    assert speed(world, "s0") < 0.1
    assert x(world, "s0") < 185 - 5


def test_appearing_ahead_inside_a_lane(world, country):
    routes = drivers((0, 100, 10)).replace('id="calm"', 'id="calm" maxSpeed="10"')
    begin(world, country.road(routes))
    ego = world.admit(50.0, RIGHT, 0.0, 0.0)
    world.step(10)
    drive(world, ego, lambda t: (170.0, RIGHT, 0.0, 0.0), 200)
    assert speed(world, "s0") < 0.1


def test_appearing_ahead_on_a_single_lane(world, country):
    """The shadow leaves the net for one step instead."""
    routes = from_arm("w", "e", 60).replace('id="calm"', 'id="calm" maxSpeed="10"')
    begin(world, country.cross(routes))
    ego = world.admit(-190.0, -1.6, 0.0, 0.0)
    world.step(10)
    drive(world, ego, lambda t: (-80.0, -1.6, 0.0, 0.0), 200)
    assert speed(world, "s0") < 0.1


def test_a_lane_change_leaves_no_ghost(world, country):
    """With keepRoute 1, the driver would stop behind a ghost. (Drivers do not overtake on the right.)"""
    begin(world, country.road(drivers((1, 100, 15))))
    ego = world.admit(160.0, LEFT, 0.0, 5.0)

    def motion(t):
        return 160 + 5 * t, LEFT - 3.2 * min(t / 3, 1), 0.0, 5.0

    drive(world, ego, motion, 200)
    assert x(world, "s0") > 160 + 5 * 20 + 30
    assert speed(world, "s0") == pytest.approx(20.0)


def test_straddling_two_lanes_stops_both(world, country):
    begin(world, country.road(drivers((0, 100, 10), (1, 100, 10))))
    ego = world.admit(300.0, -3.2, 0.0, 0.0)
    drive(world, ego, lambda t: (300.0, -3.2, 0.0, 0.0), 220)
    for name in ("s0", "s1"):
        assert speed(world, name) < 0.1
        assert x(world, name) < 300 - 5


@pytest.mark.parametrize(("lane", "lean"), [(LEFT, 0.4), (RIGHT, -0.4)])
def test_a_tail_in_the_next_lane_stops_that_lane_too(world, country, lane, lean):
    """The ego stops during a lane change; SUMO assumes that the whole vehicle has the offset of its front."""
    begin(world, country.road(drivers((0, 20, 10), (1, 20, 10))))
    middle = 300 - 2.5 * math.cos(lean), lane - 2.5 * math.sin(lean)
    ego = world.admit(*middle, lean, 0.0)
    drive(world, ego, lambda t: (*middle, lean, 0.0), 250)
    for name in ("s0", "s1"):
        assert speed(world, name) < 0.1
        assert x(world, name) < 300 - 7


def test_drifting_over_the_line_stops_the_next_lane_too(world, country):
    """SUMO detects only on entry to a lane whether a vehicle straddles the next one."""
    begin(world, country.road(drivers((0, 20, 10), (1, 20, 10))))
    ego = world.admit(300.0, RIGHT, 0.0, 0.0)
    drive(world, ego, lambda t: (300.0, RIGHT + 1.4 * min(t / 3, 1), 0.0, 0.0), 250)
    for name in ("s0", "s1"):
        assert speed(world, name) < 0.1
        assert x(world, name) < 300 - 5


@pytest.mark.parametrize(("begin_at", "over"), [(RIGHT, 1.4), (LEFT, 3.2)])
def test_drifting_back_inside_a_lane_frees_the_other(world, country, begin_at, over):
    """The ego drifts over the line and back, or all the way across; the lane without the ego stays free."""
    begin(world, country.road(drivers((0, 20, 10), (1, 20, 10))))
    ego = world.admit(300.0, begin_at, 0.0, 0.0)
    over = over if begin_at == RIGHT else -over

    def motion(t):
        there, back = min(t / 3, 1), (min(max(t - 4, 0) / 3, 1) if abs(over) < 3.2 else 0)
        return 300.0, begin_at + over * (there - back), 0.0, 0.0

    drive(world, ego, motion, 250)
    ends_right = motion(25)[1] == pytest.approx(RIGHT)
    blocked, free = ("s0", "s1") if ends_right else ("s1", "s0")
    assert speed(world, blocked) < 0.1
    assert speed(world, free) == pytest.approx(20.0)


@pytest.mark.parametrize(("speed_against", "begin_at"), [(0.0, -60.0), (12.0, -20.0)])
def test_head_on_in_the_oncoming_lane(world, country, speed_against, begin_at):
    """A driver stops without emergency braking for an ego that comes the wrong way and stops."""
    begin(world, country.cross(from_arm("w", "e", 20)))
    ego = world.admit(begin_at, -1.6, math.pi, speed_against)
    hardest = 0.0
    for step in range(1, 301):
        time = min(step * 0.1, 5.0)
        world.put(ego, begin_at - speed_against * time, -1.6, math.pi, speed_against if time < 5 else 0.0)
        world.step()
        assert not touching(world)
        hardest = min(hardest, world.states.acceleration[world.slot("s0")])
    assert speed(world, "s0") < 0.1
    assert hardest > -4.6


@pytest.mark.parametrize(("arm", "offset"), [("w", 1.2), ("w", 3.2), ("e", 1.2), ("e", 2.4)])
def test_straddling_the_centre_line_stops_both_directions(world, country, arm, offset):
    """An eastbound ego stands on the west arm, left of its lane; drivers come from either side."""
    routes = from_arm(arm, "e" if arm == "w" else "w", 20, 10)
    begin(world, country.cross(routes))
    ego = world.admit(-60.0, -1.6 + offset, 0.0, 0.0)
    drive(world, ego, lambda t: (-60.0, -1.6 + offset, 0.0, 0.0), 400)
    # An ego that is entirely on the other side does not block the drivers behind it.
    has_left_the_lane = arm == "w" and offset > 3.0
    assert ("s0" not in world.names()) if has_left_the_lane else speed(world, "s0") < 0.1


def test_drifting_back_over_the_centre_line_frees_the_oncoming_lane(world, country):
    begin(world, country.cross(from_arm("e", "w", 20, 10)))
    ego = world.admit(-60.0, 0.0, 0.0, 0.0)
    drive(world, ego, lambda t: (-60.0, 0.0, 0.0, 0.0), 300)
    assert speed(world, "s0") < 0.1
    drive(world, ego, lambda t: (-60.0, max(-1.6, -0.5 * t), 0.0, 0.0), 80)
    assert "s0" not in world.names() or speed(world, "s0") > 5.0


@pytest.mark.parametrize(
    ("heading", "over", "speed_in"),
    [(0.0, -0.4, {"wc": 6.0, "cw": 0.0}), (math.pi, 0.4, {"wc": 0.0, "cw": 6.0})],
)
def test_oncoming_vehicles_have_speed_zero_in_sumo(world, country, heading, over, speed_in):
    """An ego on the centre line is a shadow on one side and a proxy on the other.

    One of the two moves against its lane; SUMO would treat it as driving away from the oncoming drivers.
    """
    begin(world, country.cross(from_arm("n", "s", 20, 10)))
    ego = world.admit(-100.0, over, heading, 6.0)
    vehicle = world.traffic._library.vehicle
    for step in range(1, 41):
        world.put(ego, -100.0 + 0.6 * step * math.cos(heading), over, heading, 6.0)
        world.step()
        if step > 1:
            speeds = {vehicle.getRoadID(name): vehicle.getSpeed(name) for name in vehicle.getIDList()}
            assert {edge: speeds[edge] for edge in speed_in} == pytest.approx(speed_in)


def test_drivers_behind_one_that_passed_still_see_the_ego_over_the_line(world, country):
    """The first driver cannot stop and passes closely; in SUMO, the second would just follow it."""
    follower = '<vehicle id="s1" type="calm" depart="0" departPos="40" departSpeed="15">'
    routes = from_arm("e", "w", 100, 15) + follower + '<route edges="ec cw"/></vehicle>'
    begin(world, country.cross(routes))
    first = x(world, "s0") - 12
    # The ego's side is 10 cm from that of s0.
    ego = world.admit(first, -0.3, 0.0, 0.0)
    drive(world, ego, lambda t: (first, -0.3, 0.0, 0.0), 300)
    assert "s0" not in world.names() or x(world, "s0") < first - 5
    assert speed(world, "s1") < 0.1
    assert x(world, "s1") > first + 5


@pytest.mark.parametrize("lean", [-0.3, 0.3])
def test_a_corner_over_the_centre_line_stops_oncoming_traffic(world, country, lean):
    """Only the ego's front, or only its tail, is in its lane."""
    begin(world, country.cross(from_arm("e", "w", 20, 10)))
    ego = world.admit(-60.0, -0.8, lean, 0.0)
    drive(world, ego, lambda t: (-60.0, -0.8, lean, 0.0), 300)
    assert speed(world, "s0") < 0.1


def test_over_the_centre_line_inside_a_junction(world, country):
    begin(world, country.cross(from_arm("e", "w", 20, 10)))
    ego = world.admit(0.0, -0.4, 0.0, 0.0)
    drive(world, ego, lambda t: (0.0, -0.4, 0.0, 0.0), 300)
    assert sumo_motion(world, ego)[0].startswith(":c")
    assert speed(world, "s0") < 0.1


def test_a_proxy_appears_in_the_step_in_which_the_ego_crosses_the_line(world, country):
    begin(world, country.cross(from_arm("n", "s", 20, 10)))
    ego = world.admit(-100.0, -1.6, 0.0, 6.0)
    known = world.traffic._library.vehicle.getIDList
    for step in range(1, 31):
        y = -1.6 + 0.05 * step
        world.put(ego, -100.0 + 0.6 * step, y, 0.0, 6.0)
        world.step()
        # A tolerance of half a step's drift.
        if abs(y + 0.9) > 0.026:
            assert len(known()) == (3 if y + 0.9 > 0.0 else 2)


@pytest.mark.parametrize(("turn", "index"), [(1, 1), (-1, 0)])
def test_an_ego_that_keeps_its_lane_in_a_bend_is_in_no_other_lane(world, country, turn, index):
    """Its tail follows the lane, so it straddles neither the next lane nor the centre line."""
    begin(world, country.bend("", turn))
    lane = world.roads.lane_of_id(f"ab_{index}")
    ego = world.admit(*world.roads.pose_at(lane, 60.0), 5.0)
    vehicle = world.traffic._library.vehicle
    for s in np.arange(60.5, 130.0, 0.5):
        px, py, heading = world.roads.pose_at(lane, float(s))
        world.put(ego, px, py, heading, 5.0)
        world.step()
        assert vehicle.getIDCount() == 1
        front = px + 2.5 * math.cos(heading), py + 2.5 * math.sin(heading)
        assert vehicle.getPosition(world.traffic._ids[ego]) == pytest.approx(front)


def test_a_proxy_is_not_in_the_world_and_is_removed_with_its_ego(world, country):
    begin(world, country.cross(from_arm("n", "s", 20, 10)))
    ego = world.admit(-60.0, 0.0, 0.0, 0.0)
    drive(world, ego, lambda t: (-60.0, 0.0, 0.0, 0.0), 5)
    known = world.traffic._library.vehicle.getIDList
    assert len(known()) == 3
    assert np.count_nonzero(world.states.alive) == 2
    world.registry.dismiss(0, ego)
    world.step()
    assert len(known()) == 1


@pytest.mark.parametrize("begin_at", [-180.0, -180.5])
def test_a_proxy_does_not_arrive_while_its_shadow_is_off_the_net(world, country, begin_at):
    """On the wrong side of the road, the ego passes a vehicle at the end of the proxy's lane."""
    still = '<vType id="still" length="1" maxSpeed="0.01"/>'
    vehicle = '<vehicle id="s0" type="still" depart="0" departPos="1"><route edges="wc ce"/></vehicle>'
    begin(world, country.cross(still + vehicle))
    ego = world.admit(begin_at, -0.4, math.pi, 10.0)
    for step in range(1, 31):
        world.put(ego, begin_at - step, -0.4, math.pi, 10.0)
        world.step()
    assert len(world.traffic._library.vehicle.getIDList()) == 2


def test_an_ego_that_jumps_is_a_new_vehicle_in_sumo(world, country):
    """SUMO could keep it in the lists of lanes that it was on, and crash."""
    begin(world, country.road(drivers((0, 400, 0))))
    ego = world.admit(100.0, RIGHT, 0.0, 15.0)
    world.step(2)
    name = world.traffic._ids[ego]
    assert sumo_motion(world, ego)[0] == "ab_0"
    for step in range(1, 4):
        world.put(ego, 100.0 + 1.5 * step, RIGHT, 0.0, 15.0)
        world.step()
    assert world.traffic._ids[ego] == name
    world.put(ego, 700.0, LEFT, 0.0, 15.0)
    world.step(2)
    assert world.traffic._ids[ego] != name
    assert sumo_motion(world, ego)[0] == "ab_1"
    assert len(world.traffic._library.vehicle.getIDList()) == 2


def test_drivers_do_not_cooperate_with_a_planned_lane_change(world, country):
    """The ego's route requires a lane change; SUMO's drivers must not react to it in advance."""
    nodes = {"a": (0, 0), "b": (500, 0), "c": (900, -50), "d": (900, 50)}
    one = 'numLanes="1" speed="20"'
    fork = country.net("fork", streets(nodes, {"ab": 'numLanes="2" speed="20"', "bc": one, "bd": one}))
    routes = drivers(*((1, 200 - 30 * number, 10) for number in range(4))).replace("ab bc", "ab bd")
    begin(world, country.files(fork, routes))
    ego = world.admit(250.0, RIGHT, 0.0, 8.0)
    world.set_route(ego, ("ab", "bd"))
    for step in range(1, 250):
        world.put(ego, 250 + 0.8 * step, RIGHT, 0.0, 8.0)
        world.step()
        if step > 50:
            assert speed(world, "s3") == pytest.approx(20.0)


def test_reversing_in_the_lane(world, country):
    """SUMO does not treat an ego that reverses towards a driver as a leader that drives away."""
    begin(world, country.road(drivers((0, 100, 8))))
    ego = world.admit(300.0, RIGHT, 0.0, -3.0)
    drive(world, ego, lambda t: (300 - 3 * min(t, 10), RIGHT, 0.0, -3.0 if t < 10 else 0.0), 250)
    assert speed(world, "s0") < 0.1


@pytest.mark.parametrize(("arm", "has_route"), [("s", True), ("e", False)])
def test_drivers_yield_to_an_ego_with_right_of_way(world, country, arm, has_route):
    """Drivers come from the minor road, or turn left; an ego without a route is expected to go straight."""
    to = {"s": "n", "e": "s"}[arm]
    begin(world, country.cross(from_arm(arm, to)))
    ego = world.admit(-130.0, -1.6, 0.0, 12.0)
    if has_route:
        world.set_route(ego, ("wc", "ce"))
    slowest = 100.0
    for step in range(1, 160):
        world.put(ego, -130 + 1.2 * step, -1.6, 0.0, 12.0)
        world.step()
        assert not touching(world)
        if world.states.position[ego, 0] < 0:
            slowest = min(slowest, speed(world, "s0"))
    assert slowest < 4.0
    assert speed(world, "s0") > 8


def test_a_driver_with_right_of_way_stops_for_an_ego_in_the_junction(world, country):
    """The ego stands across the oncoming lane during its left turn."""
    begin(world, country.cross(from_arm("e", "w")))
    ego = world.admit(2.0, 1.0, 2.2, 0.0)
    drive(world, ego, lambda t: (2.0, 1.0, 2.2, 0.0), 250)
    assert speed(world, "s0") < 0.1


def test_a_slot_reused_by_another_ego_in_the_same_step(world, country):
    begin(world, country.road(drivers((0, 100, 10))))
    ego = world.admit(250.0, RIGHT, 0.0, 0.0)
    world.step(5)
    world.registry.dismiss(0, ego)
    assert world.admit(400.0, LEFT, 0.0, 0.0) == ego
    world.step(5)
    assert sumo_motion(world, ego)[0] == "ab_1"
    assert world.traffic._library.vehicle.getIDCount() == 2


def test_traffic_keeps_clear_of_starts(world, country):
    """Neither traffic of the warm-up nor vehicles that depart in the first step overlap an ego's start."""
    routes = CALM + (
        '<flow id="f" type="calm" from="ab" to="bc" begin="0" end="100" period="0.1" departPos="200"'
        ' departLane="0" departSpeed="0"/>'
    )
    for warm_up in (0.0, 20.0):
        world.clear()
        ego = world.admit(200.0, RIGHT, 0.0, 0.0)
        world.reset(country.road(routes, warm_up))
        drive(world, ego, lambda t: (200.0, RIGHT, 0.0, 0.0), 100)
        gap = np.abs(world.states.position[:, 0] - 200)[world.states.alive & (world.states.owner == 1)]
        assert (gap > 5).all()


def test_traffic_does_not_depart_onto_a_vehicle_that_enters_in_the_same_step(world, country):
    late = '<vehicle id="{}" depart="5" departPos="{}" departSpeed="0"><route edges="ab"/></vehicle>'
    world.reset(country.road(late.format("near", 200) + late.format("far", 400)))
    world.step(50)
    assert not world.names()
    world.admit(197.5, RIGHT, 0.0, 0.0)
    world.step()
    assert sorted(world.names()) == ["ego", "far"]


def test_sumo_survives_many_egos_in_busy_traffic(world, country):
    """The egos drive through other vehicles, at any angle, on and off the road."""
    world.reset(country.cross())
    rng = np.random.Generator(np.random.Philox(5))
    egos = [world.admit(*rng.uniform(-60, 60, 2), rng.uniform(-3, 3), 5.0) for _ in range(6)]
    turn = rng.uniform(-0.1, 0.1, len(egos))
    for step in range(600):
        for ego, rate in zip(egos, turn, strict=True):
            heading = world.states.heading[ego] + rate * 0.1
            position = world.states.position[ego] + 0.8 * np.array([math.cos(heading), math.sin(heading)])
            if np.abs(position).max() > 80:
                position, heading = -position, heading
            world.put(ego, *position, heading, 8.0)
        world.step()
        assert all(world.states.alive[ego] for ego in egos), f"an ego vanished in step {step}"
    assert world.states.alive.sum() > 8
