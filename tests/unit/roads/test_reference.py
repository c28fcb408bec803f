"""The kernels against plain NumPy, with headings, routes and several maps in one call."""

import numpy as np
import pytest

from smarts.roads.corridors import route_corridor
from smarts.roads.kernels import find_row
from smarts.roads.routes import random_route
from tests.road_queries import RoadQueries

from . import maps, reference

POSES = 100
NAMES = tuple(maps.MAPS)


@pytest.fixture(scope="module")
def atlas(graphs):
    return RoadQueries([graphs[name] for name in NAMES])


@pytest.fixture(scope="module")
def segments(atlas):
    return [reference.Segments(graph) for graph in atlas.graphs]


@pytest.fixture(scope="module")
def scene(atlas):
    """Poses on all maps, each on a route of its own that passes it or not."""
    generator = np.random.default_rng(3)
    count = POSES * len(NAMES)
    world = np.tile(np.arange(len(NAMES), dtype=np.int32), POSES)
    routes = [(m, random_route(atlas.graphs[m], generator, max_edges=4)) for m in world]
    lane = np.empty(count, np.int32)
    for i, (m, route) in enumerate(routes):
        lanes = route_corridor(atlas.graphs[m], route).lane if i % 4 else range(len(atlas.graphs[m].lane_ids))
        lane[i] = generator.choice(lanes)
    s = np.array([generator.uniform(0, atlas.graphs[m].length[n]) for m, n in zip(world, lane, strict=True)])
    position, heading = atlas.poses(world, lane, s, generator.normal(scale=1.2, size=count))
    heading = heading + generator.normal(scale=0.3, size=count)
    return world, position, heading, routes, atlas.route_table(routes)


def test_locate(atlas, segments, scene):
    world, position, heading, routes, table = scene
    numbers = np.arange(len(world), dtype=np.int32)
    found = atlas.locate(world, position, heading, numbers, table)
    ties = 0
    for i, (m, route) in enumerate(routes):
        lane, s, t, distance, cost, second = reference.locate(segments[m], *position[i], heading[i], route)
        if second - cost < 1e-6:
            ties += 1
            continue
        assert found.lane[i] == lane
        assert [found.s[i], found.t[i], found.distance[i]] == pytest.approx([s, t, distance], abs=1e-6)
    assert ties < 0.05 * len(world)


def test_project_and_poses_are_inverse(atlas, scene):
    """On straight stretches exactly; in bends to the turn between two points of the centreline."""
    world, position, heading, *_ = scene
    found = atlas.locate(world, position, heading)
    s, t = atlas.project(world, found.lane, position)
    np.testing.assert_allclose(s, found.s, atol=1e-9)
    np.testing.assert_allclose(t, found.t, atol=1e-9)
    back, _ = atlas.poses(world, found.lane, s, t)
    error = np.hypot(*(back - position).T)
    assert np.median(error) < 1e-9
    on_lane = found.distance == np.abs(found.t)
    assert error[on_lane].max() < 0.5


def test_one_call_for_all_maps_equals_one_call_each(atlas, scene):
    world, position, heading, *_ = scene
    together = atlas.locate(world, position, heading)
    for m in range(len(NAMES)):
        rows = world == m
        alone = RoadQueries([atlas.graphs[m]]).locate(
            np.zeros(POSES, np.int32), position[rows], heading[rows]
        )
        np.testing.assert_array_equal(alone.lane, together.lane[rows])
        np.testing.assert_array_equal(alone.t, together.t[rows])


@pytest.mark.parametrize("with_route", [True, False])
def test_waypoints(atlas, segments, scene, with_route):
    world, position, heading, routes, table = scene
    numbers = np.arange(len(world), dtype=np.int32) if with_route else np.full(len(world), -1, np.int32)
    found = atlas.locate(world, position, heading, numbers, table)
    # Maps take turns, so that every so many rounds have all maps.
    for i in (i for i in range(len(world)) if i // len(NAMES) % 4 == 0):
        m, route = routes[i]
        graph, base = atlas.graphs[m], atlas.roads.lane_base[m]
        row = find_row(table, len(NAMES) + i, base + found.lane[i], np.nan)
        leg = (table.group[row] - table.group[table.start[len(NAMES) + i]]) // 2
        followed = (route, leg) if with_route and row >= 0 else (None, None)
        expected = reference.waypoints(segments[m], found.lane[i], *position[i], *followed, lookahead=60)[:32]
        options = {"paths": 32, "lookahead": 60}
        paths, _ = atlas.waypoints(table, m, position[i], found.lane[i], numbers[i], **options)
        assert len(paths) == len(expected)
        for path, way in zip(paths, expected, strict=True):
            rows = [(*graph.pose_at(lane, s), base + lane, s) for lane, s in way]
            np.testing.assert_allclose(path, np.array(rows).reshape(-1, 5), atol=1e-6)
