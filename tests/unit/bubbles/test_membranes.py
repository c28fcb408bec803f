"""Where vehicles are relative to bubbles, step by step, against shapely."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from shapely import affinity
from shapely.geometry import LineString, Point, box

from smarts.bubbles.field import BubbleField
from smarts.bubbles.outlines import Place
from smarts.types.vehicles import Owner
from smarts.types.world import World
from tests.unit.bubbles.shapes import NUMBERS, bubble, random_zone

ALL = np.ones(1, np.bool_)


class Ground:
    """One simulation without a map, whose vehicles are put where a test wants them."""

    def __init__(self, *bubbles, vehicles=1, capacity=8):
        self.world = World(worlds=1, capacity=capacity, agents=2, lanes=1, egos=0)
        self.field = BubbleField(self.world)
        self.field.begin(0, bubbles)
        for _ in range(vehicles):
            self.add()

    def add(self):
        return self.world.registry.admit(0, "car", Owner.TRAFFIC, 0, 4.0, 1.8)

    def put(self, slot, x, y, heading=0.0):
        """Put a vehicle's front bumper somewhere."""
        position = x - 2 * math.cos(heading), y - 2 * math.sin(heading)
        self.world.vehicles.position[0, slot] = position
        self.world.vehicles.heading[0, slot] = heading

    def begin(self):
        self.world.settle(0)
        self.field.update(ALL)

    def step(self, places):
        self.world.advance(ALL)
        for slot, place in places.items():
            self.put(slot, *place)
        self.field.update(ALL)

    def read(self, name, slot=0, number=0):
        return int(getattr(self.field.membranes, name)[0, number, slot])


@given(NUMBERS)
@settings(deadline=None, max_examples=40)
def test_random_motion_against_shapely(number):
    random = np.random.default_rng(number)
    zones = [random_zone(random) for _ in range(2)]
    margins = random.choice([0.0, 4.0], 2)
    ground = Ground(*map(bubble, zones, margins), vehicles=3)
    fronts = random.uniform(-60, 60, (3, 2))
    for slot, front in enumerate(fronts):
        ground.put(slot, *front, random.uniform(-3, 3))
    ground.begin()
    for _ in range(20):
        before, fronts = fronts, fronts + random.normal(size=(3, 2)) * 8
        ground.step({slot: (*front, random.uniform(-3, 3)) for slot, front in enumerate(fronts)})
        for slot in range(3):
            for z, (zone, margin) in enumerate(zip(zones, margins, strict=True)):
                wide = zone.buffer(margin, cap_style="square", join_style="mitre") if margin else zone
                point, way = Point(fronts[slot]), LineString([before[slot], fronts[slot]])
                here = zone.contains(point) + wide.contains(point)
                reached = zone.intersects(way) + wide.intersects(way)
                assert ground.read("here", slot, z) == here
                assert ground.read("reached", slot, z) == reached


@given(NUMBERS)
@settings(deadline=None, max_examples=40)
def test_the_way_in_a_moving_bubble_is_the_way_in_its_own_frame(number):
    random = np.random.default_rng(number)
    zone = box(-3, -2, 4, 6)
    moving = bubble(zone, followed="leader", follow_offset=(1.0, 12.0))
    ground = Ground(moving, vehicles=2)
    ground.field.rows.followed[0, 0], ground.field.rows.followed_generation[0, 0] = 0, 1
    centre, heading, front = random.uniform(-9, 9, 2), random.uniform(-3, 3), random.uniform(-20, 20, 2)

    def own_frame():
        """Return the front relative to the zone as the file has it."""
        back = affinity.rotate(Point(front - centre), -(heading - math.pi / 2), (0, 0), use_radians=True)
        return Point(back.x + zone.centroid.x - 1.0, back.y + zone.centroid.y - 12.0)

    def places():
        leader = centre + 2 * np.array([math.cos(heading), math.sin(heading)])
        return {0: (*leader, heading), 1: tuple(front)}

    for slot, place in places().items():
        ground.put(slot, *place)
    ground.begin()
    for _ in range(20):
        before = own_frame()
        centre, heading = centre + random.normal(size=2) * 3, heading + random.normal() / 5
        front = front + random.normal(size=2) * 5
        ground.step(places())
        assert ground.read("here", 1) == 2 * zone.contains(own_frame())
        assert ground.read("reached", 1) == 2 * zone.intersects(LineString([before, own_frame()]))


def test_a_thin_zone_is_entered_by_a_vehicle_that_jumps_it():
    ground = Ground(bubble(box(10, -5, 10.5, 5), 1.0))
    ground.put(0, 8.0, 0.0)
    ground.begin()
    ground.step({0: (14.0, 0.0)})
    assert (ground.read("here"), ground.read("reached"), ground.read("entered")) == (0, Place.ZONE, 1)
    ground.step({0: (20.0, 0.0)})
    assert (ground.read("reached"), ground.read("entered")) == (Place.OUTSIDE, 1)


@pytest.mark.parametrize(
    ("heights", "place"),
    [((8.0, 9.0), Place.ZONE), ((0.0, 0.0), Place.OUTSIDE), ((-math.inf, math.inf), Place.ZONE)],
)
def test_a_zone_on_a_road_is_at_that_road_s_height(heights, place):
    ground = Ground(bubble(box(10, -5, 20, 5), heights=heights))
    ground.put(0, 5.0, 0.0)
    ground.begin()
    ground.world.vehicles.height[0, 0] = 11.5
    ground.step({0: (15.0, 0.0)})
    assert ground.read("here") == place


def test_a_newcomer_is_at_a_point_and_inherits_nothing():
    ground = Ground(bubble(box(10, -5, 11, 5), 1.0))
    ground.put(0, 5.0, 0.0)
    ground.begin()
    ground.step({0: (10.5, 0.0)})
    ground.field.membranes.refused[0, 0, 0] = True
    ground.world.advance(ALL)
    ground.world.registry.dismiss(0, 0)
    assert ground.add() == 0
    ground.put(0, 20.0, 0.0)
    ground.field.update(ALL)
    assert [ground.read(name) for name in ("here", "reached", "entered", "refused")] == [0, 0, -1, 0]


def test_a_refusal_holds_until_the_vehicle_has_left_the_margin():
    ground = Ground(bubble(box(0, -5, 10, 5), 5.0))
    ground.put(0, 5.0, 0.0)
    ground.begin()
    ground.field.membranes.refused[0, 0, 0] = True
    for x, refused in ((12.0, 1), (5.0, 1), (14.9, 1), (15.1, 0), (5.0, 0)):
        ground.step({0: (x, 0.0)})
        assert ground.read("refused") == refused


def test_a_scenario_with_more_bubbles_makes_room_and_changes_nothing_for_the_others():
    world = World(worlds=2, capacity=4, agents=1, lanes=1, egos=0)
    field, both = BubbleField(world), np.ones(2, np.bool_)
    field.begin(0, (bubble(box(0, 0, 10, 10)),))
    slot = world.registry.admit(0, "car", Owner.TRAFFIC, 0, 4.0, 1.8)
    world.vehicles.position[0, slot] = 5.0, 5.0
    field.update(both)
    field.begin(1, tuple(bubble(box(0, 0, size, size), id=f"{size}") for size in (1, 2, 3)))
    assert field.membranes.here[0, 0, slot] == Place.ZONE
    assert field.states.is_active.tolist() == [[True, False, False], [True, True, True]]
    field.update(both)
    assert field.found.tolist() == [1, 0]
    assert field.rows.first.tolist() == [0, 1]
