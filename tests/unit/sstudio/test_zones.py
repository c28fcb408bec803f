import math

import pytest

from smarts.errors import MapError
from smarts.sstudio import types as t
from smarts.sstudio.sstypes.zone_geometry import SEAM
from tests.raising import raises


def test_a_rectangle():
    area = t.PositionalZone(pos=(10, 20), size=(4, 2)).to_geometry()
    assert area.bounds == (8, 19, 12, 21)


def test_a_turned_rectangle():
    area = t.PositionalZone(pos=(10, 20), size=(4, 2), rotation=math.pi / 2).to_geometry()
    assert area.bounds == pytest.approx((9, 18, 11, 22))


def test_two_corners_make_a_rectangle():
    area = t.ConfigurableZone([(3, 4), (0, 0)]).to_geometry()
    assert area.bounds == (0, 0, 3, 4)
    assert area.area == 12


def test_corners_may_have_heights():
    area = t.ConfigurableZone([(0, 0, 1), (4, 0, 2), (0, 2, 3)]).to_geometry()
    assert (area.area, area.has_z) == (4, False)
    assert t.ConfigurableZone([(3, 4, 1), (0, 0, 1)]).to_geometry().area == 12


def test_a_polygon():
    triangle = t.ConfigurableZone([(0, 0), (4, 0), (0, 2)])
    assert triangle.to_geometry().area == 4
    # About the middle of its bounding box, (2, 1), the corner (0, 0) turns counter-clockwise to (3, -1).
    turned = t.ConfigurableZone([(0, 0), (4, 0), (0, 2)], rotation=math.pi / 2).to_geometry()
    assert turned.bounds == pytest.approx((1, -1, 3, 3))


def test_polygons_of_one_corner_are_refused():
    with pytest.raises(ValueError, match="fewer than two corners"):
        t.ConfigurableZone([(0, 0)])


def test_a_stretch_of_lanes(roads):
    lane = roads.lane_number("from_west", 0)
    (x0, y0, heading), (x1, y1, _) = roads.pose_at(lane, 10), roads.pose_at(lane, 40)
    assert heading == pytest.approx(0)
    width = float(roads.width[lane])
    one = t.MapZone(("from_west", 0, 10), length=30, n_lanes=1).to_geometry(roads)
    half = (width + SEAM) / 2
    assert one.bounds == pytest.approx((x0, y0 - half, x1, y1 + half))
    both = t.MapZone(("from_west", 0, 10), length=30).to_geometry(roads)
    assert both.geom_type == "Polygon"
    assert both.area == pytest.approx(30 * (2 * width + SEAM), rel=1e-3)


def test_named_offsets_of_a_stretch(roads):
    lane = roads.lane_number("from_west", 0)
    begin, end = roads.pose_at(lane, 0)[0], roads.pose_at(lane, float(roads.length[lane]))[0]

    def extent(offset, length):
        left, _, right, _ = t.MapZone(("from_west", 0, offset), length, 1).to_geometry(roads).bounds
        return left, right

    assert extent("base", 20) == pytest.approx((begin, begin + 20))
    assert extent("max", 20) == pytest.approx((end - 20, end))
    assert extent("base", "max") == pytest.approx((begin, end))
    left, right = extent("random", 20)
    assert begin <= left
    assert right <= end
    assert right - left == pytest.approx(20)


def test_lanes_of_a_random_stretch_begin_side_by_side(roads):
    width = float(roads.width[roads.lane_number("from_west", 0)])
    area = t.MapZone(("from_west", 0, "random"), 20, n_lanes=2).to_geometry(roads)
    left, low, right, high = area.bounds
    assert (right - left, high - low) == pytest.approx((20, 2 * width + SEAM), rel=1e-3)


def test_zones_off_the_road(roads):
    with raises(MapError, values=[2]):
        t.MapZone(("from_west", 1, 0), 10, n_lanes=2).to_geometry(roads)


def test_edges_inside_the_junction(roads):
    turn = t.JunctionEdgeIDResolver("from_west", 0, "to_south", 0).to_edge(roads)
    assert turn.startswith(":centre")
    # No connection joins just these two lanes: then the one between the edges is meant.
    assert t.JunctionEdgeIDResolver("from_west", 1, "to_south", 0).to_edge(roads) == turn
    with raises(MapError, values=["from_west", "from_east"]):
        t.JunctionEdgeIDResolver("from_west", 0, "from_east", 0).to_edge(roads)


def test_zones_along_lanes_that_sumo_measures_otherwise(long_roads):
    """Offsets and lengths of zones are SUMO's: the lane is drawn 100 m long and counts 200 m."""
    lane = long_roads.lane_number("one", 0)
    assert long_roads.length[lane] == pytest.approx(100, abs=1)
    assert long_roads.sumo_length[lane] == pytest.approx(200)
    scale = float(long_roads.length[lane] / long_roads.sumo_length[lane])
    area = t.MapZone(("one", 0, 120), 60, 1).to_geometry(long_roads)
    west, _, east, _ = area.bounds
    assert (west, east) == pytest.approx((120 * scale, 180 * scale))
    whole = t.MapZone(("one", 0, "base"), "max", 1).to_geometry(long_roads).bounds
    assert whole[2] - whole[0] == pytest.approx(float(long_roads.length[lane]))
    last = t.MapZone(("one", 0, "max"), 50, 1).to_geometry(long_roads).bounds
    assert (last[0], last[2]) == pytest.approx((150 * scale, 200 * scale))
