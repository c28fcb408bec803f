import math

import pytest

from smarts.errors import MapError
from smarts.sstudio import types as t
from smarts.sstudio.sstypes.zone_geometry import SEAM
from tests.raising import raises


def test_a_polygon():
    triangle = t.ConfigurableZone([(0, 0), (4, 0), (0, 2)])
    assert triangle.to_geometry().area == 4
    # About the middle of its bounding box, (2, 1), the corner (0, 0) turns counter-clockwise to (3, -1).
    turned = t.ConfigurableZone([(0, 0), (4, 0), (0, 2)], rotation=math.pi / 2).to_geometry()
    assert turned.bounds == pytest.approx((1, -1, 3, 3))


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


def test_edges_inside_the_junction(roads):
    turn = t.JunctionEdgeIDResolver("from_west", 0, "to_south", 0).to_edge(roads)
    assert turn.startswith(":centre")
    # No connection joins just these two lanes: then the one between the edges is meant.
    assert t.JunctionEdgeIDResolver("from_west", 1, "to_south", 0).to_edge(roads) == turn
    with raises(MapError, values=["from_west", "from_east"]):
        t.JunctionEdgeIDResolver("from_west", 0, "from_east", 0).to_edge(roads)
