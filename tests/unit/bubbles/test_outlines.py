"""Outlines against shapely, for random zones, margins, ways and poses."""

import math

import numpy as np
from hypothesis import given, settings
from shapely import affinity
from shapely.geometry import LineString, Point

from smarts.bubbles.outlines import Place, bubble_pose, bubble_table, deepest_on, place_of
from tests.unit.bubbles.shapes import NUMBERS, bubble, random_zone

NEAR = 1e-7
"""Points this near to an outline may be on either side [m]."""


def to_file(x, y, pose_x, pose_y, turn):
    """Return a point of the map in the coordinates of a bubble of a pose."""
    back = affinity.rotate(Point(x - pose_x, y - pose_y), -turn, origin=(0, 0), use_radians=True)
    return back.x, back.y


def wide(zone, margin):
    return zone.buffer(margin, cap_style="square", join_style="mitre") if margin else zone


@given(NUMBERS)
@settings(deadline=None, max_examples=60)
def test_places_of_points_are_those_of_shapely(number):
    random = np.random.default_rng(number)
    zones = [random_zone(random) for _ in range(3)]
    margins = random.choice([0.0, 0.5, 5.0], 3)
    table = bubble_table(map(bubble, zones, margins))
    for x, y in random.uniform(-80, 80, (40, 2)):
        for which, (zone, margin) in enumerate(zip(zones, margins, strict=True)):
            point = Point(x, y)
            if min(zone.boundary.distance(point), wide(zone, margin).boundary.distance(point)) < NEAR:
                continue
            expected = Place.ZONE if zone.contains(point) else Place.OUTSIDE
            if not expected and wide(zone, margin).contains(point):
                expected = Place.MARGIN
            assert place_of(table, which, x, y) == expected


@given(NUMBERS)
@settings(deadline=None, max_examples=60)
def test_ways_reach_what_shapely_says_they_reach(number):
    random = np.random.default_rng(number)
    zone, margin = random_zone(random), float(random.choice([0.0, 0.5, 5.0]))
    table = bubble_table([bubble(zone, margin)])
    for _ in range(40):
        begin = random.uniform(-80, 80, 2)
        end = begin + random.normal(size=2) * random.choice([0.5, 3.0, 30.0])
        way = LineString([begin, end])
        for area in (zone, wide(zone, margin)):
            if area.boundary.distance(way) < NEAR and not area.buffer(-NEAR).intersects(way):
                break
        else:
            expected = Place.ZONE if zone.intersects(way) else Place.OUTSIDE
            if not expected and wide(zone, margin).intersects(way):
                expected = Place.MARGIN
            assert deepest_on(table, 0, *begin, *end) == expected


@given(NUMBERS)
@settings(deadline=None, max_examples=60)
def test_a_bubble_travels_as_a_rigid_body(number):
    """Its centroid is at the offset from the vehicle; the offset is given for a vehicle that faces north."""
    random = np.random.default_rng(number)
    zone = random_zone(random)
    offset = tuple(random.uniform(-20, 20, 2).tolist())
    table = bubble_table([bubble(zone, followed="leader", follow_offset=offset)])
    x, y = random.uniform(-500, 500, 2)
    heading = random.uniform(-math.pi, math.pi)
    moved = affinity.translate(zone, offset[0] - zone.centroid.x, offset[1] - zone.centroid.y)
    moved = affinity.rotate(moved, heading - math.pi / 2, origin=(0, 0), use_radians=True)
    moved = affinity.translate(moved, x, y)
    pose = bubble_pose(table, 0, x, y, heading)
    for px, py in random.uniform(-60, 60, (20, 2)) + np.array(moved.centroid.coords):
        if moved.boundary.distance(Point(px, py)) > NEAR:
            inside = place_of(table, 0, *to_file(px, py, *pose)) == Place.ZONE
            assert inside == moved.contains(Point(px, py))
