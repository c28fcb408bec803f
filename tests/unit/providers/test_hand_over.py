"""Hand-overs between SUMO and agents: a vehicle keeps its SUMO id, and its pose and speed do not jump."""

import numpy as np
import pytest

from smarts.geometry.frames import wrap_angle
from smarts.providers.sumo_fading import ASIDE, FadingPoses
from smarts.types.vehicles import Owner, VehicleKind
from smarts.types.world import World as State

from .test_sumo_shadows import LEFT, RIGHT, begin, drive, drivers, from_arm, speed, x


def coast(world, slot, steps, turn=0.0):
    """Move a vehicle at its current speed, turned by `turn` [rad] per step."""
    states = world.states
    for _ in range(steps):
        heading = states.heading[slot] + turn
        v = states.speed[slot]
        step = v * 0.1 * np.array([np.cos(heading), np.sin(heading)])
        world.put(slot, *(states.position[slot] + step), heading, v)
        world.step()


class MotionCheck:
    """Records the worst deviations of a vehicle's motion from its speed and heading."""

    def __init__(self, world, slot):
        self.world, self.slot = world, slot
        self.worst_step = self.worst_speed = self.worst_turn = self.worst_aside = 0.0
        self.keep()

    def keep(self):
        states = self.world.states
        self.position = states.position[self.slot].copy()
        self.speed = states.speed[self.slot]
        self.heading = states.heading[self.slot]

    def step(self, count):
        for _ in range(count):
            self.world.step()
            states = self.world.states
            moved = states.position[self.slot] - self.position
            along = moved @ [np.cos(self.heading), np.sin(self.heading)]
            aside = moved @ [-np.sin(self.heading), np.cos(self.heading)]
            self.worst_step = max(self.worst_step, abs(along - states.speed[self.slot] * 0.1))
            self.worst_aside = max(self.worst_aside, abs(aside))
            self.worst_speed = max(self.worst_speed, abs(states.speed[self.slot] - self.speed))
            self.worst_turn = max(self.worst_turn, abs(wrap_angle(states.heading[self.slot] - self.heading)))
            self.keep()


def test_there_and_back_on_the_road(world, country):
    begin(world, country.road(drivers((0, 100, 10), (0, 60, 10))), 3.0)
    slot = world.slot("s0")
    generation = world.states.generation[slot]
    world.states.owner[slot] = Owner.AGENT
    coast(world, slot, 50)
    assert world.route(slot) == ("ab", "bc")
    motion = MotionCheck(world, slot)
    world.states.owner[slot] = Owner.TRAFFIC
    motion.step(50)
    # At most 2.6 m/s^2 up and 4.5 m/s^2 down for a calm driver.
    assert motion.worst_speed < 0.46
    assert motion.worst_step < 1e-6
    assert motion.worst_aside < 1e-6
    assert world.slot("s0") == slot
    assert world.states.generation[slot] == generation
    assert world.traffic._ids[slot] == "s0"
    world.step(1000)
    assert "s0" not in world.names()


def test_a_vehicle_that_leaves_the_road_is_replaced_and_drivers_see_it_again(world, country):
    """SUMO may keep the one that has left in the list of a lane, and crash when another vehicle comes by."""
    begin(world, country.road(drivers((0, 100, 10), (0, 20, 10))), 3.0)
    slot, route = world.slot("s0"), world.route(world.slot("s0"))
    world.states.owner[slot] = Owner.AGENT
    place = float(world.states.position[slot, 0])
    drive(world, slot, lambda t: (place, (RIGHT + LEFT) / 2, 0.0, 0.0), 10)
    drive(world, slot, lambda t: (place, RIGHT - 20, 0.5, 0.0), 30)
    name = world.traffic._ids[slot]
    assert name != "s0"
    assert "s0" not in world.traffic._library.vehicle.getIDList()
    assert speed(world, "s1") > 8
    back = x(world, "s1") + 90
    drive(world, slot, lambda t: (back, RIGHT, 0.0, 0.0), 200)
    assert speed(world, "s1") < 0.1
    assert world.traffic._ids[slot] == name
    assert world.route(slot) == route


def test_sumo_changes_lanes_only_of_the_vehicles_that_it_drives(world, country):
    """An agent's vehicle keeps its lane behind a slow vehicle; after the hand-over, SUMO overtakes."""
    slow = '<vType id="slow" vClass="truck" maxSpeed="3"/><vehicle id="slow" type="slow" depart="0" '
    slow += 'departLane="0" departPos="180" departSpeed="max"><route edges="ab bc"/></vehicle>'
    keen = drivers((0, 100, 10)).replace('lcSpeedGain="0" lcKeepRight="0"', 'lcSpeedGain="5"')
    begin(world, country.road(keen + slow), 0.5)
    slot = world.slot("s0")
    world.states.owner[slot] = Owner.AGENT
    world.states.speed[slot] = 3.0
    coast(world, slot, 100)
    assert world.sumo_lane(slot) == "ab_0"
    world.states.owner[slot] = Owner.TRAFFIC
    world.step(120)
    assert world.sumo_lane(slot) == "ab_1"


@pytest.mark.parametrize("offset", [-0.9, 1.5])
def test_return_beside_the_middle_of_the_lane(world, country, offset):
    begin(world, country.road(drivers((0, 100, 10))), 3.0)
    slot = world.slot("s0")
    world.states.owner[slot] = Owner.AGENT
    for step in range(1, 31):
        position = world.states.position[slot]
        world.put(slot, position[0] + 1.2, RIGHT + offset * step / 30, 0.0, 12.0)
        world.step()
    motion = MotionCheck(world, slot)
    world.states.owner[slot] = Owner.TRAFFIC
    motion.step(100)
    assert motion.worst_step < 1e-6
    assert motion.worst_aside < 0.1 + 1e-6
    assert motion.worst_speed < 0.46
    assert world.states.position[slot, 1] == pytest.approx(RIGHT)


def begin_lane_change(world, country):
    """Return the slot of a vehicle in the middle of a change to the left lane, behind a slow vehicle."""
    routes = drivers((0, 150, 3), (0, 60, 15)).replace('lcSpeedGain="0"', 'lcSpeedGain="5"')
    slow = '<vType id="slow" maxSpeed="3"/><vehicle id="s0" type="slow"'
    begin(world, country.road(routes.replace('<vehicle id="s0" type="calm"', slow)))
    slot = world.slot("s1")
    while not RIGHT + 0.5 < world.states.position[slot, 1] < LEFT - 1.0:
        world.step()
    return slot


def test_take_over_during_a_lane_change(world, country):
    """SUMO completes its lane change at once, wherever the agent drives; otherwise SUMO would crash."""
    slot = begin_lane_change(world, country)
    vehicle = world.traffic._library.vehicle
    vehicle.setStop("s1", "bc", 800.0, 0, 7.0)
    vehicle.setColor("s1", (1, 2, 3, 255))
    before = vehicle.getTypeID("s1"), vehicle.getSpeedFactor("s1"), vehicle.getMaxSpeedLat("s1")
    world.states.owner[slot] = Owner.AGENT
    start, y = world.states.position[slot].tolist()
    drive(world, slot, lambda t: (start + 2 * t, y, 0.0, 2.0), 50)
    name = world.traffic._ids[slot]
    assert name != "s1"
    assert [(stop.lane, stop.endPos, stop.duration) for stop in vehicle.getStops(name)] == [
        ("bc_0", 800.0, 7.0)
    ]
    assert vehicle.getColor(name) == (1, 2, 3, 255)
    assert (vehicle.getTypeID(name), vehicle.getSpeedFactor(name), vehicle.getMaxSpeedLat(name)) == before
    # Without the slow vehicle ahead there is no reason to begin another change.
    world.registry.dismiss(0, world.slot("s0"))
    motion = MotionCheck(world, slot)
    world.states.owner[slot] = Owner.TRAFFIC
    motion.step(100)
    # SUMO keeps the direction of its change, and turns the vehicle by 6 degrees about its front bumper.
    assert motion.worst_step < 0.02
    assert motion.worst_turn < 0.12
    assert motion.worst_aside < 0.4
    assert world.states.position[slot, 1] == pytest.approx(RIGHT, abs=0.01)


def test_return_off_its_route_takes_another_way(world, country):
    """The route goes straight on, but the agent turns left. SUMO finds the fastest route back."""
    begin(world, country.cross(from_arm("w", "e", 150)))
    slot = world.slot("s0")
    world.states.owner[slot] = Owner.AGENT
    world.put(slot, 1.6, 30.0, np.pi / 2, 8.0)
    world.step()
    motion = MotionCheck(world, slot)
    world.states.owner[slot] = Owner.TRAFFIC
    motion.step(50)
    assert motion.worst_step < 1e-6
    assert world.route(slot) == ("cn", "nc", "ce")
    while world.route(slot) != ("ce",):
        world.step()


def test_return_inside_a_junction(world, country):
    begin(world, country.cross(from_arm("w", "e", 150)))
    slot = world.slot("s0")
    while not world.sumo_lane(slot).startswith(":"):
        world.step()
    world.states.owner[slot] = Owner.AGENT
    coast(world, slot, 3)
    motion = MotionCheck(world, slot)
    world.states.owner[slot] = Owner.TRAFFIC
    motion.step(50)
    assert motion.worst_step < 0.01
    assert world.sumo_lane(slot) == "ce_0"


def test_return_off_the_road_leaves_the_world(world, country):
    begin(world, country.road(drivers((0, 100, 10))))
    slot = world.slot("s0")
    world.states.owner[slot] = Owner.AGENT
    world.put(slot, 200.0, -40.0, 0.0, 5.0)
    world.step()
    world.states.owner[slot] = Owner.TRAFFIC
    world.step()
    assert world.names() == []
    world.step(10)


def test_sumo_drives_traffic_that_another_provider_admitted(world, country):
    begin(world, country.cross(from_arm("e", "w")))
    slot = world.admit(-100.0, -1.6, 0.0, 10.0, Owner.TRAFFIC)
    world.set_route(slot, ("wc", "ce"))
    world.step()
    assert world.states.position[slot] == pytest.approx([-100.0, -1.6])
    motion = MotionCheck(world, slot)
    motion.step(30)
    assert motion.worst_step < 1e-6
    assert world.states.position[slot, 0] > -72
    assert world.states.owner[slot] == Owner.TRAFFIC


@pytest.mark.parametrize("steps", [0, 2])
def test_hand_over_right_after_entry(world, country, steps):
    """SUMO drops a route that is set in the first step of a vehicle on the first road of its net."""
    begin(world, country.road(drivers((0, 100, 10))))
    ego = world.admit(900.0, RIGHT, 0.0, 10.0)
    world.set_route(ego, ("ab", "bc"))
    for step in range(1, steps + 1):
        world.put(ego, 900.0 + step, RIGHT, 0.0, 10.0)
        world.step()
    world.states.owner[ego] = Owner.TRAFFIC
    world.step(10)
    assert world.route(ego) == ("ab", "bc")


@pytest.mark.parametrize("at", [2, 7])
def test_an_offset_that_sumo_drops_at_once_fades(at):
    """As where a truck comes to the lane behind a junction, in the second step after its release."""
    world = State(worlds=1, capacity=4, agents=0, lanes=1)
    slot = world.registry.admit(0, "truck", Owner.AGENT, VehicleKind.TRUCK, 8.0, 2.5)
    states, fading = world.vehicles.of(0), FadingPoses(world, 0)
    states.position[slot], states.speed[slot] = (0.0, 0.31), 10.0
    fading.begin(slot)
    track = [0.31]
    for step in range(1, 21):
        # SUMO's pose.
        states.position[slot], states.heading[slot] = (float(step), 0.31 if step < at else 0.0), 0.0
        fading.apply({slot} if step <= at else {})
        track.append(float(states.position[slot, 1]))
    assert np.abs(np.diff(track)).max() < ASIDE + 1e-9
    assert track[at] == pytest.approx(0.31 - ASIDE)
    assert track[-1] == 0.0
