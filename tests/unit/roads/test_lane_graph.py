import dataclasses
import math

import numpy as np
import pytest

from smarts.errors import MapError
from smarts.roads.lane_graph import LaneGraph
from tests.raising import raises


def test_unknown_edge_names_the_nearest(cross):
    with raises(MapError, values=["west_inn", "'west_in'"]):
        cross.edge_number("west_inn")
    with raises(MapError, values=["west_in_7", "west_in_0"]):
        cross.lane_of_id("west_in_7")


def test_pose_on_a_straight_lane(cross):
    lane = cross.lane_number("west_in", 0)
    assert cross.pose_at(lane, 30.0) == pytest.approx((-70.0, -4.8, 0.0))
    assert cross.pose_at(lane, 30.5, t=1.5) == pytest.approx((-69.5, -3.3, 0.0))
    assert cross.pose_at(cross.lane_number("north_in", 0), 10.0, 1.0) == pytest.approx(
        (-3.8, 90.0, -math.pi / 2)
    )


def test_sumo_drives_the_length_of_the_shape_where_another_is_given(cross):
    lane = cross.lane_number("west_in", 0)
    lanes = [*cross.edge_lanes(int(cross.lane_edge[lane]))]
    given = cross.sumo_length.copy()
    given[lanes] *= 3.0
    reckoned = dataclasses.replace(cross, sumo_length=given)
    assert reckoned.driven_length[lanes] == pytest.approx(cross.length[lanes].mean())
    others = np.delete(np.arange(len(given)), lanes)
    assert np.array_equal(reckoned.driven_length[others], given[others])
    assert np.array_equal(cross.driven_length, cross.sumo_length)


def test_saved_graph_is_the_same_graph(tmp_path, graphs):
    for name, graph in graphs.items():
        graph.save(tmp_path / name)
        again = LaneGraph.load(tmp_path / name)
        for field in dataclasses.fields(LaneGraph):
            before, after = getattr(graph, field.name), getattr(again, field.name)
            if isinstance(before, np.ndarray):
                assert before.dtype == after.dtype
            np.testing.assert_array_equal(before, after)
