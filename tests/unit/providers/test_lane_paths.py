"""Paths along the lanes of routes, compared with cases worked out by hand."""

import dataclasses
import math

import numpy as np
import pytest

from smarts.providers.lane_paths import LanePaths
from smarts.roads.lane_graph import LaneKind
from tests import maps

ONWARD, LEFT = ("west_in", "east_out"), ("west_in", "north_out")


@pytest.fixture(scope="module")
def roads():
    return maps.crossing(gap=8.0)


def numbers(roads, route):
    return tuple(map(roads.edge_number, route))


def test_the_pose_of_a_nearest_point_is_the_original_pose(roads):
    paths = LanePaths([roads])
    path = paths.add(0, numbers(roads, ONWARD))
    x, y, heading = roads.pose_at(roads.lane_number("west_in", 0), 20.0)
    found = paths.nearest([path], x, y + 0.5, heading + 0.1)
    assert found == (path, pytest.approx(20.0), pytest.approx(0.5))
    (there,) = paths.poses(np.array([path]), np.array([found[1]]), np.array([found[2]]))
    assert there == pytest.approx([x, y + 0.5, heading])
    assert paths.nearest([path], x, y + 4.0, heading)[0] == -1
    assert paths.nearest([path], x, y, heading + math.pi)[0] == -1
    assert paths.nearest([], x, y, heading)[0] == -1


def test_poses_are_bit_equal_whichever_paths_were_added_before(roads):
    alone, after = LanePaths([roads]), LanePaths([roads])
    after.add(0, numbers(roads, LEFT))
    s = np.random.default_rng(0).uniform(0.0, 100.0, 1000)
    one, other = (
        paths.poses(np.full(1000, paths.add(0, numbers(roads, ONWARD))), s, 0.1 * s)
        for paths in (alone, after)
    )
    assert one.tobytes() == other.tobytes()


def test_paths_leave_bicycle_lanes_to_others():
    """The right lane of "near" is for bicycles; its left one leads to the left lane of "far"."""
    near = maps.Road([(0.0, 0.0), (50.0, 0.0)], lanes=2)
    far = maps.Road([(60.0, 0.0), (110.0, 0.0)], lanes=2)
    roads = maps.graph_of({"near": near, "far": far}, [(("near", 0), ("far", 0)), (("near", 1), ("far", 1))])
    kind = roads.kind.copy()
    kind[roads.lane_number("near", 0)] = LaneKind.BICYCLE
    paths = LanePaths([dataclasses.replace(roads, kind=kind)])
    path = paths.add(0, numbers(roads, ("near", "far")))
    ((_, y, _),) = paths.poses(np.array([path]), np.array([20.0]), np.array([0.0]))
    assert y == pytest.approx(3.2)
