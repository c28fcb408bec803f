"""Places on the cross by hand: lanes 3.2 m wide, centred 1.6 m and 4.8 m to the right of the axes."""

import math

import numpy as np
import pytest
import shapely

from smarts.roads.lane_graph import LaneKind
from smarts.roads.sumo_net import read_net
from tests import maps as hand_made
from tests.road_queries import RoadQueries

from . import maps


@pytest.fixture(scope="module")
def atlas(cross):
    return RoadQueries([cross])


def world(count=1):
    return np.zeros(count, np.int32)


def locate(atlas, x, y, heading=None, route=None):
    place = np.array([[x, y]], float)
    heading = None if heading is None else np.array([heading])
    if route is None:
        found = atlas.locate(world(), place, heading)
    else:
        table = atlas.route_table([(0, route)])
        found = atlas.locate(world(), place, heading, world(), table)
    return atlas.graphs[0].lane_ids[found.lane[0]], found.s[0], found.t[0]


def leads_to(atlas, lane_id):
    """Return the road lane behind a junction lane."""
    graph = atlas.graphs[0]
    lane = graph.lane_of_id(lane_id)
    while graph.is_internal[lane]:
        (lane,) = graph.successors(lane)
    return graph.lane_ids[lane]


@pytest.mark.parametrize(
    ("x", "y", "lane", "s", "t"),
    [
        (-50, -4.8, "west_in_0", 50, 0),
        (-50, -4.0, "west_in_0", 50, 0.8),
        (-50, -1.0, "west_in_1", 50, 0.6),
        (-50, 2.0, "west_out_1", 39.6, -0.4),
        (2.0, 60, "north_out_1", 49.6, -0.4),
        (-50, -9.0, "west_in_0", 50, -4.2),
    ],
)
def test_lane_position(atlas, x, y, lane, s, t):
    assert locate(atlas, x, y) == (lane, pytest.approx(s), pytest.approx(t))


def test_heading_decides_where_junction_lanes_cross(atlas):
    # Eastbound and northbound centrelines cross here.
    assert leads_to(atlas, locate(atlas, 1.6, -1.6, heading=0.0)[0]) == "east_out_1"
    assert leads_to(atlas, locate(atlas, 1.6, -1.6, heading=math.pi / 2)[0]) == "north_out_1"


def test_route_decides_where_junction_lanes_diverge(atlas):
    place = (-9.5, -1.55)
    for target in ("east_out", "north_out"):
        lane, _, _ = locate(atlas, *place, heading=0.02, route=("west_in", target))
        assert leads_to(atlas, lane) == f"{target}_1"


def test_a_corner_cut_in_a_junction_keeps_the_lane(atlas):
    lane, _, t = locate(atlas, -4.5, 2.2, heading=math.pi / 4, route=("west_in", "north_out"))
    assert leads_to(atlas, lane) == "north_out_1"
    assert 1.6 < t < 3.2


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e300])
def test_nowhere(atlas, value):
    found = atlas.locate(world(2), np.array([[value, 0.0], [-50, -4.8]]))
    assert found.lane.tolist() == [-1, atlas.graphs[0].lane_of_id("west_in_0")]
    assert math.isnan(found.s[0])
    assert atlas.on_road(world(2), np.array([[value, 0.0], [-50, -4.8]])).tolist() == [False, True]
    s, t = atlas.project(world(2), found.lane, np.array([[value, 0.0], [-50, -4.8]]))
    assert np.isnan(s).tolist() == np.isnan(t).tolist() == [True, False]


def test_kinds_of_lanes(compile_to):
    graph = read_net(compile_to("kinds", maps.lane_kinds()))
    kinds = RoadQueries([graph])
    # From the right: sidewalk, bicycles, buses, cars, nobody; the leftmost lane ends at the axis.
    places = np.array([[50, -14.4], [50, -11.2], [50, -8.0], [50, -4.8], [50, -1.6]])
    assert kinds.on_road(world(5), places).tolist() == [False, False, True, True, False]
    foot = kinds.on_road(world(5), places, kinds={LaneKind.FOOT})
    assert foot.tolist() == [True, False, False, False, False]
    assert kinds.locate(world(5), places).lane.tolist() == [2, 2, 2, 3, 3]
    cars = kinds.locate(world(5), places, kinds={LaneKind.CAR})
    assert cars.lane.tolist() == [3] * 5
    rails = kinds.locate(world(5), places, kinds={LaneKind.RAIL})
    assert rails.lane.tolist() == [-1] * 5


def test_footprint_over_the_edge_of_the_road(atlas):
    # The road's right edge is at y = -6.4.
    position = np.array([[-50, -5.0], [-50, -5.6], [-50, -6.2], [-50, -9.0]])
    heading = np.array([0.0, 0.0, math.pi / 2, 0.3])
    length, width = np.full(4, 4.0), np.full(4, 2.0)
    corners = atlas.corners_on_road(world(4), position, heading, length, width)
    assert corners.tolist() == [4, 2, 2, 0]


@pytest.mark.parametrize("name", ["roundabout", "curve"])
def test_no_crack_between_lanes_side_by_side(graphs, name):
    """In a bend their centrelines are up to millimetres more than a lane's width apart."""
    atlas = RoadQueries([graphs[name]])
    roads, places, widest = atlas.roads, [], 0.0
    for right, left in enumerate(roads.lane_left):
        if left < 0:
            continue
        lines = [
            roads.point_xy[roads.point_start[lane] : roads.point_start[lane + 1]] for lane in (right, left)
        ]
        ours, theirs = map(shapely.LineString, lines)
        points = shapely.line_interpolate_point(ours, np.linspace(0.0, ours.length, 2000))
        feet = shapely.line_interpolate_point(theirs, shapely.line_locate_point(theirs, points))
        half, other = 0.5 * roads.lane_width[[right, left]]
        gap = shapely.distance(points, feet) - half - other
        is_seam = gap < 0.05
        widest = max(widest, gap[is_seam].max())
        share = ((half + 0.5 * gap) / (half + other + gap))[:, None]
        here, there = shapely.get_coordinates(points), shapely.get_coordinates(feet)
        places.append((here + share * (there - here))[is_seam])
    places = np.concatenate(places)
    assert widest > 1e-3
    assert atlas.on_road(world(len(places)), places).all()


def test_gaps_between_lanes_of_an_old_map(compile_to):
    """The gaps are from y = -3.3 to -3.2 and from 0.0 to 0.1, the edges of the road at -6.5 and 3.3."""
    old = RoadQueries([read_net(compile_to("gaps", maps.gaps()))])
    across = np.arange(-6.49, 3.29, 0.01)
    places = np.column_stack([np.full(len(across), 50.0), across])
    assert old.on_road(world(len(places)), places).all()
    beyond = [(50, -6.52), (50, 3.32), (-0.45, -3.25), (100.45, -3.25), (-0.1, 0.05), (100.1, 0.05)]
    assert not old.on_road(world(len(beyond)), beyond).any()
    assert old.corners_on_road(world(), [(50, -2.45)], [0.0], [4.0], [1.6]) == [4]


def test_route_distances(atlas):
    graph = atlas.graphs[0]
    table = atlas.route_table([(0, ("west_in", "east_out"))])
    lanes = ["west_in_0", "west_in_1", "east_out_1", "north_in_0"]
    lane = np.array([graph.lane_of_id(name) for name in lanes], np.int32)
    done, remaining = atlas.route_distances(table, world(4), world(4), lane, np.array([10.0, 89.6, 4.0, 4.0]))
    np.testing.assert_allclose(done, [10, 89.6, 89.6 + 20.8 + 4, np.nan])
    np.testing.assert_allclose(done[:3] + remaining[:3], 89.6 + 20.8 + 89.6)


def test_the_wedge_between_two_lanes_that_meet_at_an_angle_is_road():
    """20 degrees to the left: a metre outside the joint a point is 0.17 m beyond both lanes' ends."""
    turn = math.radians(20.0)
    onward = (50.0 * math.cos(turn), 50.0 * math.sin(turn))
    graph = hand_made.graph_of(
        {"in": hand_made.Road([(-50.0, 0.0), (0.0, 0.0)]), "on": hand_made.Road([(0.0, 0.0), onward])}
    )
    outside = np.array([math.sin(turn / 2), -math.cos(turn / 2)])
    behind = np.array([math.cos(turn), math.sin(turn)]) * 50.1
    points = np.array([outside, 1.5 * outside, 1.7 * outside, (-50.1, 0.0), behind])
    found = RoadQueries([graph]).on_road(np.zeros(5, np.int32), points)
    # The road ends where its lanes do.
    assert found.tolist() == [True, True, False, False, False]
