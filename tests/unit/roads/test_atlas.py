"""Routes that an atlas does not take, poses that are nowhere, and many lanes in one place."""

import numpy as np
import pytest

from smarts.roads.sumo_net import read_net
from tests.road_queries import RoadQueries

from . import maps


@pytest.fixture(scope="module")
def atlas(graphs):
    return RoadQueries([graphs["cross"], graphs["curve"]])


def zeros(*shape):
    return np.zeros(shape, np.int32)


def test_drawn_metres_where_sumo_counts_others(compile_to):
    """SUMO may declare another length than it draws; nothing here is in SUMO's metres."""
    sources = maps.cross()
    sources["edg"] = sources["edg"].replace('<edge id="west_in" ', '<edge id="west_in" length="197.1" ')
    graph = read_net(compile_to("declared", sources))
    declared, lane = RoadQueries([graph]), np.array([graph.lane_number("west_in", 0)])
    assert graph.sumo_length[lane[0]] == pytest.approx(197.1)
    position, _ = declared.poses(zeros(1), lane, np.array([50.0]), np.zeros(1))
    assert position[0] == pytest.approx([-50.0, -4.8])
    assert declared.locate(zeros(1), position).s == pytest.approx([50.0])
    assert declared.project(zeros(1), lane, position)[0] == pytest.approx([50.0])
    routes = declared.route_table([(0, ("west_in", "east_out"))])
    done, remaining = declared.route_distances(routes, zeros(1), zeros(1), lane, np.array([50.0]))
    assert (done[0], remaining[0]) == pytest.approx((50.0, 89.6 - 50.0 + 20.8 + 89.6))
    (path, _), _ = declared.waypoints(routes, 0, position[0], lane[0], 0, spacing=10.0)
    offsets = path[:, 4]
    assert offsets[:4] == pytest.approx([50.0, 60.0, 70.0, 80.0])
    assert offsets[4] == pytest.approx(90.0 - 89.6)
