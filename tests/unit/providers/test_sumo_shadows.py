"""Reactions of SUMO's drivers to shadows, with a case for every known pitfall of `moveToXY`."""

import math

import numpy as np
import pytest

from smarts.geometry.boxes import boxes_overlap

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


def test_a_lane_change_leaves_no_ghost(world, country):
    """With keepRoute 1, the driver would stop behind a ghost. (Drivers do not overtake on the right.)"""
    begin(world, country.road(drivers((1, 100, 15))))
    ego = world.admit(160.0, LEFT, 0.0, 5.0)

    def motion(t):
        return 160 + 5 * t, LEFT - 3.2 * min(t / 3, 1), 0.0, 5.0

    drive(world, ego, motion, 200)
    assert x(world, "s0") > 160 + 5 * 20 + 30
    assert speed(world, "s0") == pytest.approx(20.0)


def test_a_tail_in_the_next_lane_stops_that_lane_too(world, country):
    """The ego stops during a lane change; SUMO assumes that the whole vehicle has the offset of its front."""
    begin(world, country.road(drivers((0, 20, 10), (1, 20, 10))))
    middle = 300 - 2.5 * math.cos(0.4), LEFT - 2.5 * math.sin(0.4)
    ego = world.admit(*middle, 0.4, 0.0)
    drive(world, ego, lambda t: (*middle, 0.4, 0.0), 250)
    for name in ("s0", "s1"):
        assert speed(world, name) < 0.1
        assert x(world, name) < 300 - 7


def test_drifting_back_inside_a_lane_frees_the_other(world, country):
    begin(world, country.road(drivers((0, 20, 10), (1, 20, 10))))
    ego = world.admit(300.0, RIGHT, 0.0, 0.0)

    def motion(t):
        there, back = min(t / 3, 1), min(max(t - 4, 0) / 3, 1)
        return 300.0, RIGHT + 1.4 * (there - back), 0.0, 0.0

    drive(world, ego, motion, 250)
    assert speed(world, "s0") < 0.1
    assert speed(world, "s1") == pytest.approx(20.0)


def test_head_on_in_the_oncoming_lane(world, country):
    """A driver stops without emergency braking for an ego that comes the wrong way and stops."""
    begin(world, country.cross(from_arm("w", "e", 20)))
    ego = world.admit(-20.0, -1.6, math.pi, 12.0)
    hardest = 0.0
    for step in range(1, 301):
        time = min(step * 0.1, 5.0)
        world.put(ego, -20.0 - 12.0 * time, -1.6, math.pi, 12.0 if time < 5 else 0.0)
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


def test_over_the_centre_line_inside_a_junction(world, country):
    begin(world, country.cross(from_arm("e", "w", 20, 10)))
    ego = world.admit(0.0, -0.4, 0.0, 0.0)
    drive(world, ego, lambda t: (0.0, -0.4, 0.0, 0.0), 300)
    assert sumo_motion(world, ego)[0].startswith(":c")
    assert speed(world, "s0") < 0.1


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
