"""Waypoint paths on the cross by hand: road lanes 89.6 m long, the junction 20.8 m across."""

import math

import numpy as np
import pytest

from smarts.roads.waypoints import WaypointPaths
from tests.maps import straight
from tests.road_queries import RoadQueries


@pytest.fixture(scope="module")
def atlas(cross):
    return RoadQueries([cross])


def ahead(atlas, x, y, route=None, heading=0.0, hint=math.nan, **options):
    """Return the paths of one vehicle as dictionaries of arrays without padding."""
    world, position = np.zeros(1, np.int32), np.array([[x, y]], float)
    table = atlas.route_table([] if route is None else [(0, route)])
    number = np.array([-1 if route is None else 0], np.int32)
    lane = atlas.locate(world, position, np.array([heading]), number, table).lane
    paths = atlas.waypoints(table, world, position, lane, number, np.array([hint]), **options)
    return [
        {
            name: getattr(paths, name)[0, k, : paths.waypoint_count[0, k]]
            for name in WaypointPaths._fields
            if name not in ("path_count", "waypoint_count", "left_out")
        }
        for k in range(paths.path_count[0])
    ]


def lane_names(atlas, path):
    return list(dict.fromkeys(atlas.graphs[0].lane_ids[lane] for lane in path["lane"]))


def test_one_path_in_each_lane_from_the_right(atlas):
    right, left = ahead(atlas, -60.3, -2.0, lookahead=10)
    np.testing.assert_allclose(right["position"][:, 0], -60.3 + np.arange(10))
    np.testing.assert_allclose(right["position"][:, 1], -4.8)
    np.testing.assert_allclose(left["position"][:, 1], -1.6)
    assert right["lane_index"].tolist() == [0] * 10
    assert left["lane_index"].tolist() == [1] * 10
    assert left["heading"].tolist() == [0] * 10
    assert set(left["width"]) == {3.2}
    assert set(left["speed_limit"]) == {15.0}
    np.testing.assert_allclose(left["lane_offset"], 39.7 + np.arange(10))


def test_spacing(atlas):
    _, left = ahead(atlas, -60, -1.6, lookahead=5, spacing=2.5)
    np.testing.assert_allclose(left["position"][:, 0], -60 + 2.5 * np.arange(5))


def test_straight_through_the_junction(atlas):
    right, left = ahead(atlas, -20, -1.6, ("west_in", "east_out"), lookahead=50)
    for path, y in ((right, -4.8), (left, -1.6)):
        np.testing.assert_allclose(path["position"][:, 0], -20 + np.arange(50), atol=1e-9)
        np.testing.assert_allclose(path["position"][:, 1], y)
    names = lane_names(atlas, left)
    assert (names[0], names[-1], len(names)) == ("west_in_1", "east_out_1", 3)


def test_a_lane_that_leaves_the_route_ends_at_the_junction(atlas):
    right, left = ahead(atlas, -20, -1.6, ("west_in", "north_out"), lookahead=50)
    # From x = -20 in steps of 1 m to the stop line at -10.4.
    assert len(right["lane"]) == 10
    assert len(left["lane"]) == 50
    assert lane_names(atlas, left)[-1] == "north_out_1"
    assert left["heading"][-1] == pytest.approx(math.pi / 2)
    steps = np.hypot(*np.diff(left["position"], axis=0).T)
    np.testing.assert_allclose(steps, 1.0, atol=0.01)


def test_the_route_ends(atlas):
    _, left = ahead(atlas, 95, -1.6, ("west_in", "east_out"), lookahead=50)
    np.testing.assert_allclose(left["position"][:, 0], 95 + np.arange(6))


def test_inside_the_junction_only_the_branches_of_the_route(atlas):
    paths = ahead(atlas, 0.0, -1.6, ("west_in", "east_out"), lookahead=20)
    assert [lane_names(atlas, path)[-1] for path in paths] == ["east_out_0", "east_out_1"]
    for path in paths:
        assert path["position"][0, 0] == pytest.approx(0.0)


def test_a_left_turn_waiting_in_the_junction_has_one_path(atlas):
    graph = atlas.graphs[0]
    first, second = (
        lane
        for lane in atlas.route_table([(0, ("west_in", "north_out"))]).lane[-4:-2]
        if graph.is_internal[lane]
    )
    for lane, s in ((first, 1.0), (first, graph.length[first] - 0.01), (second, 0.01), (second, 8.0)):
        x, y, heading = graph.pose_at(int(lane), s)
        (path,) = ahead(atlas, x, y, ("west_in", "north_out"), heading, lookahead=30)
        np.testing.assert_allclose(path["position"][0], [x, y], atol=1e-6)
        assert lane_names(atlas, path)[-1] == "north_out_1"


def test_without_a_route_paths_fork_at_the_junction(atlas):
    paths = ahead(atlas, -15, -1.6, lookahead=40)
    ends = [lane_names(atlas, path)[-1] for path in paths]
    assert ends == ["south_out_0", "east_out_0", "east_out_1", "north_out_1"]
    for path in paths[:2]:
        np.testing.assert_allclose(path["position"][:5, 0], -15 + np.arange(5))
        np.testing.assert_allclose(path["position"][:5, 1], -4.8)


def test_off_the_route_as_without_a_route(atlas):
    astray = ahead(atlas, -15, -1.6, ("south_in", "north_out"), lookahead=40)
    free = ahead(atlas, -15, -1.6, lookahead=40)
    assert [path["lane"].tolist() for path in astray] == [path["lane"].tolist() for path in free]


def test_more_paths_than_room(atlas):
    # The left lane leads on to the east and to the north, the right one to the south and to the east.
    for room, ends in (
        (3, ["south_out_0", "east_out_1", "north_out_1"]),
        (2, ["east_out_1", "north_out_1"]),
        (1, ["east_out_1"]),
    ):
        paths = ahead(atlas, -15, -1.6, lookahead=40, paths=room)
        assert [lane_names(atlas, path)[-1] for path in paths] == ends
        paths = ahead(atlas, -15, -4.8, lookahead=40, paths=room)
        ends = [["south_out_0"], ["south_out_0", "east_out_0"], ["south_out_0", "east_out_0", "east_out_1"]]
        assert [lane_names(atlas, path)[-1] for path in paths] == ends[room - 1]


def test_what_does_not_fit_is_counted(atlas):
    number, place = np.full(1, -1, np.int32), np.array([[-15.0, -1.6]])
    lane = atlas.locate(np.zeros(1, np.int32), place).lane
    for room, left_out in ((4, 0), (3, 1), (2, 1), (1, 2)):
        found = atlas.waypoints(atlas.no_routes, np.zeros(1), place, lane, number, paths=room, lookahead=40)
        # Of the right lane that does not fit at all, one: its fork is not looked at.
        assert (found.path_count[0], found.left_out[0]) == (room, left_out)


def test_of_many_lanes_those_beside_the_own_one_are_kept():
    wide = RoadQueries([straight(lanes=12)])
    for own, first in ((0, 0), (3, 0), (6, 3), (11, 4)):
        # Left of the lane's middle, so that the neighbour on the left is the nearer one.
        place = np.array([[50.0, 3.2 * own + 0.5]])
        found = wide.waypoints(wide.no_routes, np.zeros(1), place, np.full(1, own), np.full(1, -1))
        assert found.lane_index[0, :, 0].tolist() == [*range(first, first + 8)]
        assert found.left_out[0] == 4


def test_nowhere_means_no_paths(atlas):
    assert ahead(atlas, math.nan, 0.0) == []


def test_old_contents_of_the_buffers_are_gone(atlas):
    world, number = np.zeros(1, np.int32), np.full(1, -1, np.int32)
    out = WaypointPaths.allocate(1, 4, 40)
    for x in (-15.0, 90.0):
        position = np.array([[x, -1.6]])
        lane = atlas.locate(world, position).lane
        atlas.waypoints(atlas.no_routes, world, position, lane, number, out=out)
    assert out.path_count.tolist() == [2]
    assert out.waypoint_count.tolist() == [[11, 11, 0, 0]]
    assert not out.position[0, :2, 11:].any()
    assert not out.position[0, 2:].any()


def test_round_a_lap(graphs):
    ring = RoadQueries([graphs["roundabout"]])
    route = ("ring_east", "ring_north", "ring_west", "ring_south", "ring_east")
    x, y, heading = ring.graphs[0].pose_at(ring.graphs[0].lane_number("ring_east", 0), 3.0)
    # On the first time round the path goes on; on the second the route ends with the road.
    first = ahead(ring, x, y, route, heading, lookahead=60)
    second = ahead(ring, x, y, route, heading, hint=125.0, lookahead=60)
    assert max(len(path["lane"]) for path in first) == 60
    assert max(len(path["lane"]) for path in second) < 30
