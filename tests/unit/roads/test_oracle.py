"""The kernels against sumolib and shapely on 2,000 random places of each map."""

import numpy as np
import pytest
import shapely

from tests.road_queries import RoadQueries

from . import maps
from .oracle import Oracle

PLACES = 2_000


def random_places(graph, generator):
    """Return places near lanes, those inside junctions as often as others, and some far from any."""
    near, far = PLACES * 9 // 10, PLACES - PLACES * 9 // 10
    inside = generator.random(near) < 0.5
    pools = np.flatnonzero(~graph.is_internal), np.flatnonzero(graph.is_internal)
    lane = np.where(inside, generator.choice(pools[1], near), generator.choice(pools[0], near)).astype(
        np.int32
    )
    s = generator.uniform(-2, graph.length[lane] + 2)
    t = generator.normal(scale=3.0, size=near)
    position, _ = RoadQueries([graph]).poses(np.zeros(near, np.int32), lane, s, t)
    low, high = graph.point_xy.min(axis=0) - 100, graph.point_xy.max(axis=0) + 100
    return np.concatenate((position, generator.uniform(low, high, (far, 2))))


@pytest.fixture(scope="module", params=maps.MAPS)
def case(request, graphs, sumo_nets):
    graph = graphs[request.param]
    places = random_places(graph, np.random.default_rng(7))
    atlas = RoadQueries([graph])
    return graph, Oracle(sumo_nets[request.param]), places, atlas, np.zeros(PLACES, np.int32)


def test_nearest_lane(case):
    _, oracle, places, atlas, world = case
    expected = np.array([oracle.nearest_distance(point) for point in shapely.points(places)])
    clear = ~np.isnan(expected)
    assert clear.mean() > 0.97
    found = atlas.locate(world, places)
    np.testing.assert_allclose(found.distance[clear], expected[clear], atol=1e-6)


def test_lane_position(case):
    graph, oracle, places, atlas, world = case
    found = atlas.locate(world, places)
    for i, (x, y) in enumerate(places):
        s, distance, side = oracle.on_lane(graph.lane_ids[found.lane[i]], x, y)
        assert found.distance[i] == pytest.approx(distance, abs=1e-6)
        # A point inside a bend may be equally far from two places on the lane.
        if abs(found.s[i] - s) > 1e-6:
            foot = graph.pose_at(int(found.lane[i]), found.s[i])[:2]
            assert np.hypot(x - foot[0], y - foot[1]) == pytest.approx(distance, abs=1e-6)
        elif 0.01 < s < graph.length[found.lane[i]] - 0.01 and distance > 1e-3:
            assert found.t[i] == pytest.approx(side * distance, abs=1e-6)


def test_on_road(case):
    _, oracle, places, atlas, world = case
    expected, border = oracle.on_road(places)
    # Shapely draws round corners as polygons of 128 sides.
    clear = border > 2e-3
    assert clear.mean() > 0.97
    np.testing.assert_array_equal(atlas.on_road(world, places)[clear], expected[clear])
    assert 0.2 < expected.mean() < 0.95


def test_lengths_are_those_of_the_shapes(case):
    graph, oracle, *_ = case
    for name, line in zip(oracle.ids, oracle.lines, strict=True):
        lane = graph.lane_of_id(name)
        assert graph.length[lane] == pytest.approx(line.length, abs=0.0011)
        assert graph.sumo_length[lane] == pytest.approx(oracle.lanes[name].getLength())
