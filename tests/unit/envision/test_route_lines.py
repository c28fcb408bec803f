"""Lines and poses of missions on a small map, compared with its coordinates."""

import numpy as np
import pytest

from smarts.envision.route_lines import pose_on_map, route_line, start_pose
from smarts.roads.compile import compile_map
from smarts.roads.sources import find_map_source
from smarts.roads.sumo_net import read_net
from smarts.sstudio import types as t

NODES = (
    """<nodes><node id="a" x="0" y="0"/><node id="b" x="100" y="0"/><node id="c" x="200" y="0"/></nodes>"""
)
EDGES = """<edges><edge id="first" from="a" to="b" numLanes="2" speed="10"/>
<edge id="second" from="b" to="c" numLanes="2" speed="10"/></edges>"""


SEAM = 0.3
"""By how much SUMO's shortest junction lanes may overlap the roads beside them [m]."""


@pytest.fixture(scope="module")
def roads(tmp_path_factory):
    folder = tmp_path_factory.mktemp("straight")
    (folder / "map.nod.xml").write_text(NODES)
    (folder / "map.edg.xml").write_text(EDGES)
    compile_map(find_map_source(folder), folder / "out.net.xml")
    return read_net(folder / "out.net.xml")


def test_a_line_in_one_lane_runs_from_begin_to_end(roads):
    line = route_line(roads, t.Route(begin=("first", 0, 10), end=("second", 0, "max")))
    assert np.allclose(line[0], [10, -4.8], atol=0.1)
    assert np.allclose(line[-1], [200, -4.8], atol=0.1)
    assert np.allclose(line[:, 1], -4.8, atol=0.1)
    assert (np.diff(line[:, 0]) >= -SEAM).all()


def test_a_lane_change_goes_forward_only(roads):
    line = route_line(roads, t.Route(begin=("first", 0, 10), end=("second", 1, 50)))
    assert np.allclose(line[-1], [150, -1.6], atol=0.5)
    assert (np.diff(line[:, 0]) >= -SEAM).all()


def test_a_lane_change_on_one_road(roads):
    line = route_line(roads, t.Route(begin=("first", 1, 10), end=("first", 0, 90)))
    assert np.allclose(line[[0, -1]], [[10, -1.6], [90, -4.8]], atol=0.1)
    assert (np.diff(line[:, 0]) >= -SEAM).all()


def test_poses_of_missions(roads):
    mission = t.Mission(t.Route(begin=("first", 0, "base"), end=("second", 1, "max")))
    # The front bumper is at the lane's begin, so the centre of a car of 5 m is behind it.
    assert np.allclose(start_pose(roads, mission), [-2.5, -4.8, 0], atol=0.1)
    assert np.allclose(pose_on_map(roads, mission.route.end), [200, -1.6, 0], atol=0.1)
    assert start_pose(roads, t.Mission(t.RandomRoute())) is None
