"""Waypoint paths on the cross by hand: road lanes 89.6 m long, the junction 20.8 m across."""

import math

import numpy as np
import pytest

from smarts.roads.corridors import route_corridor
from tests.maps import straight
from tests.road_queries import RoadQueries


@pytest.fixture(scope="module")
def atlas(cross):
    return RoadQueries([cross])


def ahead(atlas, x, y, route=None, heading=0.0, **options):
    """Return the paths of one vehicle and how many were left out; see `RoadQueries.waypoints`."""
    world, number = np.zeros(1, np.int32), np.array([-1 if route is None else 0], np.int32)
    table = atlas.route_table([] if route is None else [(0, route)])
    lane = atlas.locate(world, np.array([[x, y]]), np.array([heading]), number, table).lane
    return atlas.waypoints(table, 0, (x, y), lane[0], number[0], **options)


def end_of(atlas, path):
    return atlas.graphs[0].lane_ids[int(path[-1, 3])]


def test_one_path_in_each_lane_from_the_right(atlas):
    (right, left), left_out = ahead(atlas, -60.3, -2.0, lookahead=10)
    lanes = [atlas.graphs[0].lane_of_id(f"west_in_{index}") for index in range(2)]
    for path, y, lane in ((right, -4.8, lanes[0]), (left, -1.6, lanes[1])):
        expected = [(-60.3 + i, y, 0.0, lane, 39.7 + i) for i in range(10)]
        np.testing.assert_allclose(path, expected, atol=1e-9)
    assert left_out == 0


def test_a_left_turn_waiting_in_the_junction_has_one_path(atlas):
    graph, route = atlas.graphs[0], ("west_in", "north_out")
    first, second = (lane for lane in route_corridor(graph, route).lane if graph.is_internal[lane])
    for lane, s in ((first, 1.0), (first, graph.length[first] - 0.01), (second, 0.01), (second, 8.0)):
        x, y, heading = graph.pose_at(int(lane), s)
        (path,), _ = ahead(atlas, x, y, route, heading, lookahead=30)
        np.testing.assert_allclose(path[0, :2], [x, y], atol=1e-6)
        assert end_of(atlas, path) == "north_out_1"


@pytest.mark.parametrize(
    ("room", "ends_of_left", "ends_of_right", "left_out"),
    [
        (4, ["south_out_0", "east_out_0", "east_out_1", "north_out_1"], None, 0),
        (3, ["south_out_0", "east_out_1", "north_out_1"], ["south_out_0", "east_out_0", "east_out_1"], 1),
        # Of the right lane that does not fit at all, one is left out: its fork is not looked at.
        (2, ["east_out_1", "north_out_1"], ["south_out_0", "east_out_0"], 1),
        (1, ["east_out_1"], ["south_out_0"], 2),
    ],
)
def test_more_paths_than_room(atlas, room, ends_of_left, ends_of_right, left_out):
    # The left lane leads on to the east and to the north, the right one to the south and to the east.
    for y, ends in ((-1.6, ends_of_left), (-4.8, ends_of_right or ends_of_left)):
        paths, missing = ahead(atlas, -15, y, lookahead=40, paths=room)
        assert [end_of(atlas, path) for path in paths] == ends
        assert missing == left_out


def test_of_many_lanes_those_beside_the_own_one_are_kept():
    wide = RoadQueries([straight(lanes=12)])
    for own, first in ((0, 0), (3, 0), (6, 3), (11, 4)):
        # Left of the lane's middle, so that the neighbour on the left is the nearer one.
        paths, left_out = wide.waypoints(wide.no_routes, 0, (50.0, 3.2 * own + 0.5), own)
        assert [path[0, 3] for path in paths] == [*range(first, first + 8)]
        assert left_out == 4


def test_nowhere_means_no_paths(atlas):
    lane = atlas.graphs[0].lane_of_id("west_in_0")
    for place in ((math.nan, 0.0), (0.0, 1e300)):
        assert atlas.waypoints(atlas.no_routes, 0, place, lane) == ([], 0)


def test_round_a_lap(graphs):
    ring = RoadQueries([graphs["roundabout"]])
    route = ("ring_east", "ring_north", "ring_west", "ring_south", "ring_east")
    x, y, heading = ring.graphs[0].pose_at(ring.graphs[0].lane_number("ring_east", 0), 3.0)
    # On the first time round the path goes on; on the second the route ends with the road.
    first, _ = ahead(ring, x, y, route, heading, lookahead=60)
    second, _ = ahead(ring, x, y, route, heading, hint=125.0, lookahead=60)
    assert max(map(len, first)) == 60
    assert max(map(len, second)) < 30
